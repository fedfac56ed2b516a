"""Parts that join by the rays between them: those of the one to points of the other."""
