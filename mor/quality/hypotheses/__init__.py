"""What may have gone wrong: mistakes that people make, each put to the test as a change of the project."""
