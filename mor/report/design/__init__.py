"""The report of a plan: what can be expected of a network before anything of it is measured."""
