"""What terrestrial instruments observe between positions: distances, directions, angles, differences of coordinates."""
