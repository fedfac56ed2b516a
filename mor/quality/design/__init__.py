"""Design of networks: what is required of a plan, and which observations help to reach it."""
