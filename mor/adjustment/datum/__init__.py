"""Datum: the defect that is there, what binds it, S-transformation, weak directions."""
