"""What is said of gross errors: observations that were left out, and possible causes."""
