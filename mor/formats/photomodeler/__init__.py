"""PhotoModeler text exports."""
