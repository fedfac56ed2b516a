"""Report observations that were left out, and possible causes."""
