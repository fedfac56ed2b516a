"""The project file, its tables, and the network that they describe."""
