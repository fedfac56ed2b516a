"""Networks in domains: larger than memory, or over several machines. A story of its own, beside the pipeline."""
