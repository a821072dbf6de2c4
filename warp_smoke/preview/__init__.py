"""The pyvista window; the only importer of pyvista."""
