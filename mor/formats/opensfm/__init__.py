"""OpenSfM and OpenDroneMap: reconstruction, tracks, ground control."""
