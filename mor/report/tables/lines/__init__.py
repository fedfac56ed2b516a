"""The long table as text: each piece of it as lines of a CSV file."""
