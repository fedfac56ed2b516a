"""Before the measurement: plans, simulated measurements, Monte Carlo; and many projects at once."""
