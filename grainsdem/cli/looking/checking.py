"""Commands that look at a bed: validate, measure, info."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer

import grainsdem
from grainsdem.cli.guard import Written, err, guarded, out
from grainsdem.cli.options import Bed, Json, Quiet, app, load, prepare, print_json, show_summary


@app.command()
@guarded
def validate(
    bed: Bed,
    overlap: Annotated[
        float,
        typer.Option(help="Largest overlap volume allowed, relative to the smaller grain; 1e-3 for settled beds."),
    ] = 1e-9,
    against: Annotated[
        Path | None,
        typer.Option(help="Also check that every grain of this packing is there, as large and where it was."),
    ] = None,
    method: Annotated[
        Literal["planes", "manifold3d"],
        typer.Option(help="Prove pairs apart by planes where that is possible, or all by manifold3d."),
    ] = "planes",
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Check that every grain is closed and convex, and that no two overlap; exit 1 where a check fails.

    An exported file is read as the program that it is for reads it, rounding included.
    """
    import exporters
    from grainsdem.recipe import counting_words
    from grainsdem.screen import ChainProgress, print_report
    from grainsdem.validation import SHAPE, compare

    prepare("contacts", "proof", "shapes", quiet=quiet)
    packing = load(bed)
    original = None if against is None else load(against)
    with ChainProgress(err, shown=not (quiet or json_)) as progress, progress.stage("Validating") as tell:
        told = counting_words(tell, "pairs")
        # Without its sign: what is wound inside out, and has no diameter, is for the checks to name.
        size = float(np.cbrt(6 / np.pi * np.abs(grainsdem.volumes(packing))).mean())
        rounding = exporters.rounding(packing, bed.suffix) / size if size > 0 else 0.0
        report = grainsdem.validate(packing, overlap=overlap, shape=max(SHAPE, rounding), method=method, progress=told)
        if original is not None:
            report = grainsdem.Report((*compare(packing, original), *report.checks))
    if json_:
        print_json(report.to_dict())
    elif not quiet:
        print_report(out, str(bed), report)
    report.raise_if_failed()


@app.command()
@guarded
def measure(
    bed: Bed,
    within: Annotated[
        float | None,
        typer.Option(help="Gap [m] below which grains count as touching; 1e-3 of a diameter by default."),
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option(help="Also write one row a grain: .csv, .parquet, .h5 or .hdf5."),
        Written("grainsdem.measures.grains.files:check_table"),
    ] = None,
    sieves: Annotated[
        bool,
        typer.Option(help="With each grain's sieve diameter in that table; without, a large bed's takes a tenth."),
    ] = True,
    neighbors: Annotated[
        Path | None,
        typer.Option(help="Also write who grew beside whom and how far away: .csv, .parquet, .h5 or .hdf5."),
        Written("grainsdem.measures.grains.files:check_table"),
    ] = None,
    distribution: Annotated[
        bool,
        typer.Option(
            "--distribution",
            help="Also say how sizes are distributed: percentiles, φ statistics, fits of three families.",
        ),
    ] = False,
    diameter: Annotated[
        Literal["volume", "sieve"],
        typer.Option(
            help="Size of a grain in --distribution: its equal-volume diameter, or the square hole it passes."
        ),
    ] = "volume",
    net: Annotated[
        Path | None,
        typer.Option(help="Also draw where the grains' axes point: Schmidt's net and a rose (.png)."),
        Written("grainsdem.figures.frame:check_suffix"),
    ] = None,
    axis: Annotated[Literal["a", "b", "c"], typer.Option(help="Long, middle or short axis, in that picture.")] = "a",
    contacts: Annotated[
        Path | None,
        typer.Option(help="Also write who touches whom: .csv, .parquet, .graphml, or .vtp for ParaView."),
        Written("grainsdem.measures.graph.edges:check_edges"),
    ] = None,
    walls: Annotated[bool, typer.Option("--walls", help="Write contacts with walls, too, under negative ids.")] = False,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Measure a bed: porosity, grain sizes and how they are distributed, sphericity, coordination."""
    from grainsdem.screen import print_distribution

    packing = load(bed)
    # While a bed knows its cells its porosity is known in closed form.
    steps = ["contacts", *(["shapes"] if packing.links is None else []), *(["walls"] if walls else [])]
    if table is not None:
        steps += ["outlines", *(["holes"] if sieves else [])]
    prepare(*steps, quiet=quiet)
    graph = grainsdem.contacts(packing, within=within, walls=walls and contacts is not None)
    sizes = {"distribution": grainsdem.size_distribution(packing, diameter=diameter)} if distribution else {}
    if net is not None:
        grainsdem.figures.stereonet(packing, net, axis=axis)
    if neighbors is not None:
        grainsdem.write_table(grainsdem.neighbor_table(packing), neighbors)
    if table is not None:
        grainsdem.write_table(grainsdem.table(packing, sieves=sieves), table)
    if contacts is not None:
        grainsdem.write_edges(graph, contacts, packing=packing)
    if json_:
        print_json(grainsdem.summary(packing, graph.among_grains()) | sizes)
        return
    show_summary(packing, json_=json_, quiet=quiet, title=str(bed), graph=graph.among_grains())
    if sizes and not quiet:
        print_distribution(out, str(bed), sizes["distribution"])


@app.command()
@guarded
def info(bed: Bed, json_: Json = False, quiet: Quiet = False) -> None:
    """Say what a file holds and what made it."""
    from grainsdem.screen import print_info

    packing = load(bed)
    facts = {
        "grains": len(packing),
        "vertices": len(packing.grains.vertices),
        "faces": packing.grains.n_faces,
        "domain_lower": packing.domain.lower.tolist(),
        "domain_upper": packing.domain.upper.tolist(),
        "periodic": packing.domain.periodic.tolist(),
        "neighbors_known": packing.links is not None,
        "provenance": [json.loads(step) for step in packing.provenance],
    }
    if json_:
        print_json(facts)
    elif not quiet:
        print_info(out, str(bed), facts)
