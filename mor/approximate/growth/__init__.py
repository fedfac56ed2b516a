"""Parts of a network: begun, grown, joined, until everything that can be known is known."""
