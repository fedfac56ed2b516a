"""SNAP (Land Information New Zealand): command, coordinate and data files of a network on the earth."""
