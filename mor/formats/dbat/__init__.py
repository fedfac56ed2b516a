"""Projects of DBAT, the Damped Bundle Adjustment Toolbox."""
