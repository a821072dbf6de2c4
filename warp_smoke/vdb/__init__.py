"""OpenVDB files: writes dense float and vector grids to `.vdb` and reads them, with only numpy and zlib."""

from warp_smoke.vdb.grid import Grid
from warp_smoke.vdb.read import read_grid_bounds, read_grid_names, read_vdb
from warp_smoke.vdb.write import write_vdb

__all__ = ["Grid", "read_grid_bounds", "read_grid_names", "read_vdb", "write_vdb"]
