"""Start values of points alone, where frames have theirs: every point by the rays that see it, and by nothing else."""

from __future__ import annotations
