"""Linearisation, normal equations, factorisation, selected inverse, datum, solver."""
