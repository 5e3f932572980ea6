"""One bed photographed in many ways: what each option of the camera, the light and the grains does.

Grows a bed of clustered seeds, takes a dozen photographs that differ by an option or two, and draws them side by side.
Run with ``--quick`` for a small bed.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import grainsdem as gd

WAYS = {
    "nothing asked for": {},
    "a lamp close by": {"lamp": 0.9, "light": (-1, 0.3, 1.5)},
    "a gradient, a vignette": {"gradient": (0.7, -0.5), "vignette": 0.5},
    "somebody's shadow": {"shadow": 0.5, "shadow_side": 0.7, "shadow_edge": 0.1},
    "a bar's shadow": {"shadow": 0.6, "shadow_side": 2.5, "shadow_width": 0.12, "shadow_edge": 0.04},
    "an overcast sky": {"ambient": 1.0},
    "a barrel lens": {"lens": (-0.25, 0.03)},
    "a pincushion lens": {"lens": (0.3, 0.0)},
    "speckles and bands": {"texture": 0.3, "texture_size": 0.3, "bands": 0.4},
    "colours": {"colors": {"limestone": 2, "red_sandstone": 1, "chert": 1, "quartzite": 1}, "texture": 0.12},
    "the same, wet": {"colors": "limestone:2,red_sandstone:1,chert:1,quartzite:1", "texture": 0.12, "wet": True},
    "blur and noise": {"blur": 1.5, "noise": 0.04},
}


def main() -> None:
    """Take the photographs and draw the sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a small bed and few pixels")
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for photographs and sheet")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    recipe = gd.recipe.make(
        rng=4,
        domain={"lengths": [13, 13, 5], "periodic": "xy"},
        seeds={
            "process": "cluster",
            "count": 200 if options.quick else 900,
            "parents": 100,
            "spread": 0.06,
            "relax": 2,
        },
        grains={"porosity": 0.35, "median_diameter": 0.06},
    )
    bed = gd.recipe.grow(recipe)
    view = gd.planform(bed, pixel=float(bed.domain.lengths[0]) / (96 if options.quick else 480))
    pictures = []
    for name, ways in WAYS.items():
        folder = options.output / "photographs" / name.replace(" ", "_").replace(",", "").replace("'", "")
        gd.write_planform(view, bed, folder, formats=["png"], rng=1, overwrite=True, **ways)
        pictures.append(folder / "image.png")
    gd.figures.contact_sheet(pictures, options.output / "photographs.png", titles=list(WAYS))
    print(f"{len(bed)} grains in {len(pictures)} photographs; wrote {options.output / 'photographs.png'}")


if __name__ == "__main__":
    main()
