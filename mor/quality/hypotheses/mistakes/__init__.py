"""The mistakes that people make, one file for what they are made with."""
