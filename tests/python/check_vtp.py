"""Opens the fields.vtp of a run in pyvista; exits non-zero on any failure.

    python check_vtp.py RUN/fields.vtp [NAME ...]

NAMEs are point arrays that must be there, e.g. tau_out_mean.
"""

import sys

import numpy as np
import pyvista


def main(path, names):
    surface = pyvista.read(path)
    print(f"pyvista {pyvista.__version__}, {surface.n_points} points, {surface.n_cells} cells")
    assert isinstance(surface, pyvista.PolyData), f"not a surface: {type(surface).__name__}"
    assert surface.is_all_triangles and surface.n_cells > 0, "not a triangle surface"
    assert np.isfinite(surface.points).all(), "a coordinate is not finite"
    missing = set(names) - set(surface.point_data.keys())
    assert not missing, f"missing point data: {missing}; found {surface.point_data.keys()}"
    for name in surface.point_data.keys():
        values = surface.point_data[name]
        assert values.shape == (surface.n_points,), f"{name}: shape {values.shape}"
        print(f"{name}: {np.nanmin(values):.6g} to {np.nanmax(values):.6g}, {np.isnan(values).sum()} NaN")
    print("ok")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2:])
