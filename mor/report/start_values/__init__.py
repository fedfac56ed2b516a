"""What start values there are, where each comes from, and how far it is to be trusted."""
