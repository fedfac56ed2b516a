"""Who sees what: the observations of a plan that are made wherever nothing is in the way."""
