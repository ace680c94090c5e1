"""Calibration by a plane board (chessboard, ChArUco, AprilGrid, circles) or by a bar waved through the volume."""
