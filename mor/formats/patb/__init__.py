"""PAT-B's image coordinates and control points."""
