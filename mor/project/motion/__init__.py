"""Points that move: times of observations, models of movement, and what they make of points and observations."""
