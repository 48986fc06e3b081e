"""Bridges to other tools: Gymnasium, ONNX, Minari and LeRobot, your own data, logs and planners."""
