"""Looking at the observations before they are adjusted: what cannot be right, each with its place."""
