"""Shadows: of smoke on surfaces, and of surfaces on surfaces."""
