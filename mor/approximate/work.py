"""Units of work (:mod:`mor.allowance`) of the questions that start values are made of, as measured in plain numpy."""

BATCH = 2_000
"""Samples of five pairs of rays, a batch of them, and what all rays say to them."""
COPLANARITY = 850
"""An adjustment of a relative orientation."""
SAMPLES = 1_200
"""Poses of samples of three points, and what all points say to them."""
POSE = 450
"""An adjustment of a pose."""
TURN = 4.0
"""A turn of growth of every kind, besides the questions above, in iterations of as many observations as rays."""
RESIDUALS = 3
"""Residuals at many states in one call, without derivatives, that are as much as an observation in an iteration."""
CONDITIONS = 12
"""Conditions of rays at many poses in one call, that are as much as an observation in an iteration."""
