"""One self-contained page for each adjustment: templates by jinja2, charts by plotly.js, nothing from the network."""
