"""SphereCal: calibration of multi-camera measuring rigs with an imperfect ball."""

__version__ = "0.1.0"
