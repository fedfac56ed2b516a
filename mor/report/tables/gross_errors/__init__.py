"""Gross errors as plain data: observations that were left out, and possible causes."""
