"""Blocks of openMVG (``sfm_data.json``) and AliceVision, Meshroom (``.sfm``)."""
