"""Poses of frames that a plain resection does not tell: by rays of others, and once more when more is known."""
