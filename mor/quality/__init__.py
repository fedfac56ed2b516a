"""What follows the solution: redundancy, reliability, precision, tests."""
