"""On the robot: a 1 kHz loop that fails safely, and the bridge in front of a robot's driver.

Nothing here needs a simulator, PyTorch, numba or Pinocchio: NumPy and ONNX Runtime run a policy,
and the bridge needs the standard library only. Read `interfaces` next, then `loop`.
"""
