"""Compiled forms of the two hot loops of the growth: one pose, and many intersections.

Their numpy forms are ``resection_adjust.adjust_pose_plainly`` and ``intersect_points.meet_plainly``.
"""
