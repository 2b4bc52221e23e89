"""Draws docs/fields.png, the picture in the README, from the output folder of a run on known truth.

    pip install -r tests/python/requirements.txt
    python docs/fields.py out/erp docs/fields.png
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pyvista as pv

QUANTITY, TITLE, UNIT = "erp_s2", "ERP_S2", "ms"
MAPS = [("true", "truth", "viridis"), ("mean", "posterior mean", "viridis"), ("sd", "posterior sd", "magma")]
# ms by which the truth lies above (red) or below (blue) its 90 % interval; grey where it lies inside
BEYOND = ("beyond", "beyond its 90 % interval", "coolwarm")
VIEWS = [("front", (0.45, -1.0, 0.3)), ("back", (-0.35, 1.0, 0.3))]


def picture(surface, sites, array, limits, colours, direction):
    """One view of one array as an image (height, width, 3)."""
    plotter = pv.Plotter(off_screen=True, window_size=(960, 720))
    plotter.set_background("white")
    plotter.add_mesh(surface, scalars=array, clim=limits, cmap=colours, nan_color="lightgrey",
                     show_scalar_bar=False, smooth_shading=True, ambient=0.35, diffuse=0.7)
    for site in sites:
        plotter.add_mesh(pv.Sphere(radius=1.3, center=site), color="#d81b3c", ambient=0.3)
    plotter.view_vector(direction, viewup=(0, 0, 1))
    plotter.camera.zoom(1.7)
    plotter.enable_anti_aliasing("ssaa")
    return plotter.screenshot(return_img=True)


def main(run, out):
    surface = pv.read(run / "fields.vtp")
    rows = np.genfromtxt(run / "measurements.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    sites = surface.points[np.unique(rows["vertex"])]
    values = {suffix: surface[f"{QUANTITY}_{suffix}"] for suffix, *_ in MAPS}
    low, high, true = surface[f"{QUANTITY}_q5"], surface[f"{QUANTITY}_q95"], values["true"]
    beyond = np.where(true < low, true - low, np.where(true > high, true - high, np.nan))
    surface[f"{QUANTITY}_beyond"] = beyond
    known = np.isfinite(low) & np.isfinite(true)
    share = 100 * np.mean(np.isnan(beyond[known]))
    most = np.nanmax(np.abs(beyond))
    both = np.concatenate([values["true"], values["mean"]])
    shared = (np.nanmin(both), np.nanmax(both))
    limits = {"true": shared, "mean": shared, "sd": (0.0, np.nanpercentile(values["sd"], 99)),
              "beyond": (-most, most)}

    figure, axes = plt.subplots(2, 4, figsize=(13.4, 6.0), gridspec_kw={"wspace": 0.04, "hspace": 0.03})
    for column, (suffix, title, colours) in enumerate([*MAPS, BEYOND]):
        for row, (name, direction) in enumerate(VIEWS):
            axes[row, column].imshow(
                picture(surface, sites, f"{QUANTITY}_{suffix}", limits[suffix], colours, direction))
            axes[row, column].set(xticks=[], yticks=[], ylabel=name if column == 0 else None)
            axes[row, column].spines[:].set_visible(False)
        title = f"truth {title}" if suffix == "beyond" else f"{TITLE}: {title}"
        axes[0, column].set_title(title, fontsize=11)
        scale = plt.cm.ScalarMappable(plt.Normalize(*limits[suffix]), colours)
        bar = figure.colorbar(scale, ax=axes[:, column], orientation="horizontal", pad=0.02, shrink=0.8, aspect=28)
        bar.set_label(f"{UNIT}; {share:.0f} % of the surface lies inside" if suffix == "beyond" else UNIT, fontsize=9)
        bar.ax.tick_params(labelsize=9)
        bar.outline.set_visible(False)
    figure.savefig(out, dpi=110, bbox_inches="tight", pil_kwargs={"optimize": True})


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
