"""Two epochs side by side: movements with ellipses and tests, as a page."""
