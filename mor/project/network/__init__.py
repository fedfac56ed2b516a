"""From the project to the network: one builder for each section of the file."""
