"""What is reported of a network in domains: the tables put together, a summary, a short report."""
