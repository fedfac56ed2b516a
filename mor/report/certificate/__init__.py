"""The certificate of one camera: everything a calibration is judged by, on one page."""
