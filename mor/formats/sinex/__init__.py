"""SINEX: positions of stations with their covariance matrix, as a GNSS solution gives them."""
