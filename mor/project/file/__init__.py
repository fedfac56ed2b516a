"""The file itself: nodes with their lines, model, validation, schema, writing."""
