"""Movements of points between epochs."""
