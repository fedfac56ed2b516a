"""A project in domains: images divided by place, and the rows of the tables that go with them."""
