"""The permeability of a bed, by OpenFOAM, and a picture of the flow between its grains.

Writes the case, runs it (blockMesh, surfaceFeatureExtract, snappyHexMesh, simpleFoam), compares the permeability with
that of Kozeny and Carman, and draws a section. Where OpenFOAM is not installed the case is written and can be run
elsewhere: ``./Allrun`` in its folder. Run with ``--quick`` for a coarse mesh.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
from pathlib import Path

import numpy as np

import exporters
import grainsdem as gd
from exporters.openfoam import flow


def draw(case: Path, picture: Path) -> None:
    """Draw the speed in a section through the middle, and streamlines through the void."""
    import matplotlib.pyplot as plt
    import pyvista
    from matplotlib.collections import PolyCollection

    (case / "case.foam").touch()
    reader = pyvista.POpenFOAMReader(case / "case.foam")
    reader.set_active_time_value(reader.time_values[-1])
    fluid = reader.read()["internalMesh"]
    fluid.cell_data["speed"] = np.linalg.norm(fluid.cell_data["U"], axis=1)
    section = fluid.slice("y")
    lower, upper = np.reshape(fluid.bounds, (3, 2)).T

    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 5), layout="constrained")
    corners = section.points[:, [0, 2]] * 1e3
    cells = PolyCollection([corners[cell.point_ids] for cell in section.cell], array=section.cell_data["speed"] * 1e6)
    cells.set(cmap="viridis", edgecolor="face", linewidth=0.2)
    left.add_collection(cells)
    left.set(
        facecolor="#c9b38f", aspect="equal", xlabel="x [mm]", ylabel="z [mm]", title="section: grains and speed",
        xlim=(corners[:, 0].min(), corners[:, 0].max()), ylim=(corners[:, 1].min(), corners[:, 1].max()),
    )  # fmt: skip
    figure.colorbar(cells, ax=left, label="speed [µm/s]")

    points = np.random.default_rng(1).choice(fluid.cell_centers().points, 300, replace=False)
    lines = fluid.cell_data_to_point_data().streamlines_from_source(
        pyvista.PolyData(points), vectors="U", max_length=4 * (upper - lower).max(), initial_step_length=0.2
    )
    plotter = pyvista.Plotter(off_screen=True, window_size=(900, 900))
    plotter.add_mesh(
        lines.tube(radius=2e-3 * (upper - lower).max()), scalars="speed", show_scalar_bar=False, lighting=False
    )
    plotter.add_mesh(fluid.outline(), color="black")
    plotter.view_isometric()
    right.imshow(plotter.screenshot(return_img=True))
    plotter.close()
    right.set(title="streamlines")
    right.axis("off")
    figure.savefig(picture, dpi=100)


def main() -> None:
    """Print porosity, permeability and its ratio to Kozeny and Carman's."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a coarse mesh")
    parser.add_argument("--output", type=Path, default=Path("permeability"), help="folder of the case and the picture")
    choices = parser.parse_args()
    folder = choices.output
    folder.mkdir(parents=True, exist_ok=True)

    n = 400
    domain = gd.Domain.cube(1e-3 * n ** (1 / 3))
    seeds = gd.relax(gd.points.poisson(domain, n, rng=3), domain, iterations=3)
    packing = gd.shrink(gd.carve(gd.tessellate(seeds, domain)), porosity=0.4)
    case = folder / "case"
    shutil.rmtree(case, ignore_errors=True)
    # A box of three (or two) diameters in the middle: a mesh of a hundred thousand cells.
    half = (1.0 if choices.quick else 1.5) * gd.diameters(packing.grains).mean()
    box = (domain.upper / 2 - half, domain.upper / 2 + half)
    exporters.write(packing, case, formats=["openfoam"], region=box, cells=15 if choices.quick else 20)
    print(f"wrote {case}: {len(packing)} grains at a porosity of {gd.porosity(packing):.3f}")
    if shutil.which("simpleFoam") is None:
        print("OpenFOAM is not installed here; run ./Allrun in that folder where it is")
        return
    subprocess.run(["./Allrun"], cwd=case, stdout=subprocess.DEVNULL, check=True)
    found = flow(case)
    print(
        f"permeability {found.permeability:.3g} m², {found.permeability / found.kozeny_carman:.2f} of Kozeny and "
        f"Carman's {found.kozeny_carman:.3g} m², at a Reynolds number of {found.reynolds:.2g}"
    )
    draw(case, folder / "flow.png")
    print(f"wrote {folder / 'flow.png'}")


if __name__ == "__main__":
    main()
