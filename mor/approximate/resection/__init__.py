"""Space resection of a bundle on known points."""
