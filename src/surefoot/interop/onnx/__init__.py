"""Policies as ONNX files: the network, or the whole pipeline from sensors to joint targets."""
