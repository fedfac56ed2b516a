"""The network on the earth: coordinate reference system, geoid, deflections. Nothing else imports pyproj."""
