"""Networks of a project for writers: terrestrial observations, and what lies on the earth."""
