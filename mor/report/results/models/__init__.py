"""``results.json`` as models, from which its schema is made."""
