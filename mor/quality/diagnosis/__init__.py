"""Singular and hardly determined networks in words."""
