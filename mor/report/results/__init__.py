"""Results as files: ``results.json``, the adjusted project, covariances."""
