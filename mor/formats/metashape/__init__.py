"""Metashape: cameras and markers as XML."""
