"""Start values that nobody has to give: relative orientation, resection, intersection, transfer."""
