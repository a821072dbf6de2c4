"""Smoke, its shadows and baked lighting for USD stages, as NVIDIA Warp kernels on CPU or CUDA."""
