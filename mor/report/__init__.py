"""Reports: one file per section; text, JSON, CSV as renderers."""
