"""The verdict in reports: tests of groups, the reliability map."""
