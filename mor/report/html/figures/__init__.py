"""Charts as plotly describes them: plain data, one file for each section of the page."""
