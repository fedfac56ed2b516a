"""Pictures for reports and for machines that compare them: one file for each, drawn by matplotlib (extra ``plot``)."""
