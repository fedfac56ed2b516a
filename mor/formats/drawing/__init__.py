"""Results for other programs: point clouds, drawings, maps."""
