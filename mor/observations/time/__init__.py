"""Images and measurements whose pose is a function of time."""
