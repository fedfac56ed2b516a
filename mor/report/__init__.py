"""Tables, results.json, texts, pages, plots, certificates, languages."""
