"""One bed of a set: grown, photographed as often as asked, and the truth about each photograph."""

from __future__ import annotations

import hashlib
import json
import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from grainsdem import recipe as recipes
from grainsdem.atomic import write_all
from grainsdem.errors import GrainsDEMError, InputError, WriteError
from grainsdem.geometry.forms.sizes import grain_diameters
from grainsdem.measures import summary
from grainsdem.measures.grains.files import table_content
from grainsdem.measures.planform import pebble_count, photograph, planform, planform_table, size_percentiles
from grainsdem.measures.planform.camera.lens import CameraLens
from grainsdem.measures.planform.files import image_content, labels_content
from grainsdem.packing.carve import unwarned

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from grainsdem.measures.planform import Planform
    from grainsdem.model import Packing
    from grainsdem.recipe import Recipe
    from grainsdem.recipe.views import Draw, ImagesTable


class Picture(NamedTuple):
    """One photograph of a set.

    Parameters
    ----------
    number : int
        From 1.
    rng : int
        Seed of all that is drawn for it.
    """

    number: int
    rng: int

    @property
    def stem(self) -> str:
        """What the names of its files begin with."""
        return f"image_{self.number:04d}"


class Sitting(NamedTuple):
    """The photographs of one bed.

    Parameters
    ----------
    recipe : Recipe
        Of all beds.
    table : ImagesTable
        What the photographs are drawn from.
    bed : int
        Number of the bed, from 1.
    rng : int
        Seed of the bed and of what is varied.
    pictures : tuple of Picture
        Those that are missing.
    folder : Path
        Where files go.
    """

    recipe: Recipe
    table: ImagesTable
    bed: int
    rng: int
    pictures: tuple[Picture, ...]
    folder: Path


Row = dict[str, Any]


def seed_of(*words: str) -> int:
    """Return a seed that follows from some words; of 53 bits, exact in every program that reads the table."""
    return int.from_bytes(hashlib.sha256(" ".join(words).encode()).digest()[:8], "big") >> 11


def files_of(picture: Picture, table: ImagesTable) -> list[str]:
    """Return the names of a photograph's files, that of the image first."""
    return [
        *(f"{picture.stem}.{suffix}" for suffix in table.formats),
        *(f"{picture.stem}.labels.{suffix}" for suffix in table.labels),
        *(f"{picture.stem}.grains.{suffix}" for suffix in table.grains),
    ]


def take(sitting: Sitting) -> list[Row]:
    """Grow a bed, photograph it, write the files, and return a row for each photograph: of the truth, or of the error.

    Raises
    ------
    WriteError
        If a file cannot be written: what cannot be written now cannot be later.
    """
    rng = sitting.rng
    try:
        own = _recipe_of(sitting)
        rng = own.rng
        with unwarned():  # told of many beds, one line each, nobody would read it
            bed = recipes.grow(own)
            if own.settle is not None:
                bed = recipes.come_to_rest(bed, own).packing
        share = summary(bed)["porosity"]  # of the cells, or where grains have left them of a box inside the bed
    except WriteError:
        raise
    except GrainsDEMError as error:
        return [{**_known(sitting, picture, rng), "error": _line(error)} for picture in sitting.pictures]
    rows = []
    for picture in sitting.pictures:
        row = _known(sitting, picture, rng)
        try:
            rows.append(
                {
                    **row,
                    **_photographed(bed, sitting, picture),
                    "porosity": math.nan if share is None else share,
                    "error": "",
                }
            )
        except WriteError:
            raise
        except GrainsDEMError as error:
            rows.append({**row, "error": _line(error)})
    return rows


def _recipe_of(sitting: Sitting) -> Recipe:
    """Return the recipe of a bed; its rng is zero where there is no chance in it."""
    changes = _changes(sitting)
    own = recipes.varied(sitting.recipe.model_copy(update={"rng": 0}), changes) if changes else sitting.recipe
    return own.model_copy(update={"rng": sitting.rng if own.has_chance or own.settle is not None else 0})


def _changes(sitting: Sitting) -> Row:
    return sitting.table.draw_bed(np.random.default_rng(sitting.rng))


def _known(sitting: Sitting, picture: Picture, rng: int) -> Row:
    """Return what a row has whether or not the photograph can be taken."""
    return {
        "file": files_of(picture, sitting.table)[0],
        "image": picture.number,
        "bed": sitting.bed,
        "bed_rng": rng,
        "rng": picture.rng,
        **{key.replace(".", "_"): value for key, value in _changes(sitting).items()},
    }


def _photographed(bed: Packing, sitting: Sitting, picture: Picture) -> Row:
    """Take one photograph, write its files, and return what is true of it."""
    table, generator = sitting.table, np.random.default_rng(picture.rng)
    drawn = table.draw(generator)
    view = _framed(bed, table, drawn)
    image = photograph(view, bed, **drawn.camera, rng=generator)
    lens = CameraLens.of(view, drawn.camera["lens"])
    labels, rows = lens.nearest(view.labels), planform_table(view, bed)
    counted = pebble_count(view, bed, table.stones, rows=rows, rng=generator)
    content = [image_content(image, suffix) for suffix in table.formats]
    content += [labels_content(labels, suffix) for suffix in table.labels]
    content += [table_content(rows, f".{suffix}") for suffix in table.grains]
    write_all(sitting.folder, dict(zip(files_of(picture, table), content, strict=True)))
    return {
        "width": table.size[0],
        "height": table.size[1],
        "scale": float(view.pixel.mean()) * lens.scale,
        "lower_x": float(view.corner[0]),
        "lower_y": float(view.corner[1]),
        **told(drawn),
        "n_grains": len(bed),
        "n_seen": rows.size,
        "n_whole": int((~rows["is_cut"] & (rows["n_pixels"] >= table.least_pixels)).sum()),
        "n_counted": counted.size,
        **size_percentiles(rows, bed, counted, least_pixels=table.least_pixels),
    }


def _framed(bed: Packing, table: ImagesTable, drawn: Draw) -> Planform:
    """Return what is seen of a bed in a picture that lies within its domain."""
    lengths, counts = bed.domain.lengths[:2], np.array(table.size)
    pixel = float((lengths / counts).min()) if drawn.scale is None else drawn.scale
    if table.per_diameter is not None:
        pixel = float(grain_diameters(bed).mean()) / pixel
    room = lengths - pixel * counts
    # A billionth: the picture that fills the bed is as wide as it but for rounding.
    if (room < -1e-9 * lengths).any():
        raise InputError(
            f"a picture of {counts[0]} × {counts[1]} pixels of {pixel:.4g} m does not fit into the bed, "
            f"{lengths[0]:.4g} × {lengths[1]:.4g} m: ask for smaller pixels, fewer of them, or a larger bed"
        )
    lower = bed.domain.lower[:2] + np.maximum(room, 0.0) * drawn.places
    return planform(bed, pixel=pixel, region=(lower, lower + pixel * counts))


def told(drawn: Draw) -> Row:
    """Return what a photograph was taken with as columns of a table, one a number."""
    row: Row = {}
    for name, value in drawn.camera.items():
        if name == "light":
            x, y, z = value
            row |= {"light_azimuth": math.atan2(y, x), "light_elevation": math.atan2(z, math.hypot(x, y))}
        elif name == "gradient":
            row |= {"gradient_x": value[0], "gradient_y": value[1]}
        elif name == "lens":
            row |= {"lens_k1": value[0], "lens_k2": value[1]}
        elif name == "colors":
            row["colors"] = "" if value is None else json.dumps(value)
        else:
            row[name] = int(value) if isinstance(value, bool) else math.nan if value is None else value
    return row


def columns(table: ImagesTable, percentiles: Sequence[str]) -> list[str]:
    """Return the columns of the table of truth between the first and the last."""
    names = [key.replace(".", "_") for key in table.vary]
    names += ["width", "height", "scale", "lower_x", "lower_y", *told(table.draw(np.random.default_rng(0)))]
    return [*names, "porosity", "n_grains", "n_seen", "n_whole", "n_counted", *percentiles]


def _line(error: GrainsDEMError) -> str:
    return " ".join(str(error).split())
