"""The project file: nodes with line numbers, model, tables, axes and units at the edge, writing."""
