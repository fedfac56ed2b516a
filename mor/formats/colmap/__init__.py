"""COLMAP models: cameras, images, points3D, rigs and frames, as text or binary."""
