"""The text files of an OpenFOAM case."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

SIDES = ("x_lower", "x_upper", "y_lower", "y_upper", "z_lower", "z_upper")
"""Patches of the faces along the flow, all in the group ``sides``."""


class Case(NamedTuple):
    """What the dictionaries say.

    Parameters
    ----------
    lower, upper : ndarray, shape (3,)
        Corners [m] of the flow domain.
    cells : ndarray of int, shape (3,)
        Background cells along each axis.
    axis : int
        Along which fluid flows, from the lower face to the upper.
    sides : {"slip", "noSlip"}
        What the four faces along the flow do.
    level : int
        Times that background cells are halved at the grains.
    void_point : ndarray, shape (3,)
        A point [m] of the void.
    viscosity : float
        Kinematic viscosity [m²/s].
    pressure_drop : float
        Kinematic pressure [m²/s²] at the inlet; zero at the outlet.
    has_walls : bool
        Whether there is a surface of the container's walls besides that of the grains.
    cyclic : tuple of bool, shape (3,)
        Along which axes opposite faces are one; along the flow, the pressure's mean gradient is a force on the fluid.
    per_grain : bool
        Whether the surface of grains has a region a grain.
    """

    lower: Floats
    upper: Floats
    cells: NDArray[np.int64]
    axis: int
    sides: str
    level: int
    void_point: Floats
    viscosity: float
    pressure_drop: float
    has_walls: bool
    cyclic: tuple[bool, bool, bool] = (False, False, False)
    per_grain: bool = False

    @property
    def is_periodic(self) -> bool:
        """Whether fluid that leaves comes in again."""
        return self.cyclic[self.axis]


def texts(case: Case) -> dict[str, str]:
    """Return the dictionaries of a case and the script that runs it: path to text."""
    ends = SIDES[2 * case.axis : 2 * case.axis + 2] if case.is_periodic else ("inlet", "outlet")
    driven = {
        "constant/fvOptions": _head("dictionary", "fvOptions") + _force(case),
        "constant/fvModels": _head("dictionary", "fvModels") + _force_foundation(case),
    }
    return {
        "Allrun": _ALLRUN.replace("@ENDS@", " ".join(ends)),
        "0.orig/U": _head("volVectorField", "U") + _velocity(case),
        "0.orig/p": _head("volScalarField", "p") + _pressure(case),
        # Which of the two a version reads: up to OpenFOAM 9 and all of ESI's the first, later ones the second.
        "constant/transportProperties": _head("dictionary", "transportProperties")
        + f"transportModel Newtonian;\nnu [0 2 -1 0 0 0 0] {case.viscosity:.9g};\n",
        "constant/physicalProperties": _head("dictionary", "physicalProperties")
        + f"viscosityModel constant;\nnu [0 2 -1 0 0 0 0] {case.viscosity:.9g};\n",
        "constant/turbulenceProperties": _head("dictionary", "turbulenceProperties") + "simulationType laminar;\n",
        "constant/momentumTransport": _head("dictionary", "momentumTransport") + "simulationType laminar;\n",
        "system/blockMeshDict": _head("dictionary", "blockMeshDict") + _block_mesh(case),
        "system/snappyHexMeshDict": _head("dictionary", "snappyHexMeshDict") + _snappy(case),
        "system/surfaceFeatureExtractDict": _head("dictionary", "surfaceFeatureExtractDict") + _features(case),
        "system/surfaceFeaturesDict": _head("dictionary", "surfaceFeaturesDict") + _features_foundation(case),
        "system/decomposeParDict": _head("dictionary", "decomposeParDict") + _parted(case),
        "system/controlDict": _head("dictionary", "controlDict")
        + _CONTROL.replace("@RATE@", _DRIFT if case.is_periodic else _RATE),
        "system/fvSchemes": _head("dictionary", "fvSchemes") + _SCHEMES,
        "system/fvSolution": _head("dictionary", "fvSolution") + _SOLUTION,
        **(driven if case.is_periodic else {}),
    }


def _parted(case: Case) -> str:
    """Return how the mesh is shared out: in slices along the flow, for which no version lacks a library."""
    slices = " ".join("$numberOfSubdomains" if k == case.axis else "1" for k in range(3))
    return f"numberOfSubdomains 2;\nmethod simple;\nsimpleCoeffs {{ n ({slices}); delta 0.001; }}\n"


def surfaces(case: Case) -> list[str]:
    """Return the names of the surfaces that the mesh is cut by."""
    return ["grains", "walls"] if case.has_walls else ["grains"]


def _head(kind: str, name: str) -> str:
    return f"FoamFile\n{{\n    version 2.0;\n    format ascii;\n    class {kind};\n    object {name};\n}}\n\n"


def _vector(values: Floats) -> str:
    return "(" + " ".join(f"{value:.12g}" for value in values.tolist()) + ")"


def _fields(case: Case, inlet: str, outlet: str, sides: str, still: str) -> str:
    """Return what a field does at every patch."""
    told = {} if case.is_periodic else {"inlet": inlet, "outlet": outlet}
    told |= dict.fromkeys((name for k, name in enumerate(SIDES) if case.cyclic[k // 2]), "type cyclic;")
    if any(k != case.axis and not case.cyclic[k] for k in range(3)):
        told["sides"] = sides
    told |= dict.fromkeys(surfaces(case), still)
    return "boundaryField\n{\n" + "".join(f"    {name} {{ {does} }}\n" for name, does in told.items()) + "}\n"


def _velocity(case: Case) -> str:
    free = "type pressureInletOutletVelocity; value uniform (0 0 0);"
    return "dimensions [0 1 -1 0 0 0 0];\ninternalField uniform (0 0 0);\n" + _fields(
        case, free, free, f"type {case.sides};", "type noSlip;"
    )


def _pressure(case: Case) -> str:
    flat, held = "type zeroGradient;", "type fixedValue; value uniform"
    return "dimensions [0 2 -2 0 0 0 0];\ninternalField uniform 0;\n" + _fields(
        case, f"{held} {case.pressure_drop:.9g};", f"{held} 0;", flat, flat
    )


def _gradient(case: Case) -> str:
    """Return the mean gradient of the kinematic pressure, turned round, as a vector [m/s²]."""
    length = float(case.upper[case.axis] - case.lower[case.axis])
    return _vector(case.pressure_drop / length * np.eye(3)[case.axis])


def _force(case: Case) -> str:
    return (
        "drive\n{\n    type vectorSemiImplicitSource;\n    active yes;\n    vectorSemiImplicitSourceCoeffs\n    {\n"
        "        selectionMode all;\n        volumeMode specific;\n"
        f"        injectionRateSuSp {{ U ({_gradient(case)} 0); }}\n    }}\n}}\n"
    )


def _force_foundation(case: Case) -> str:
    return (
        "drive\n{\n    type semiImplicitSource;\n    select all;\n    cellZone all;\n    volumeMode specific;\n"
        f"    sources {{ U {{ explicit {_gradient(case)}; implicit 0; }} }}\n}}\n"
    )


def _block_mesh(case: Case) -> str:
    corners = [
        [(case.upper if high else case.lower)[k] for k, high in enumerate(which)]
        for which in [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    ]
    vertices = "".join("    (" + " ".join(f"{x:.12g}" for x in corner) + ")\n" for corner in corners)
    faces = ["(0 4 7 3)", "(1 2 6 5)", "(0 1 5 4)", "(3 7 6 2)", "(0 3 2 1)", "(4 5 6 7)"]
    kind = "wall" if case.sides == "noSlip" else "patch"
    patches = []
    for k, face in enumerate(faces):
        # A patch a plane: snappyHexMesh keeps the points of a patch in its plane only where it is plane.
        name, does = SIDES[k], f"type {kind}; inGroups (sides);"
        if case.cyclic[k // 2]:
            does = f"type cyclic; neighbourPatch {SIDES[k ^ 1]};"
        elif k // 2 == case.axis:
            name, does = ("inlet", "outlet")[k % 2], "type patch;"
        patches.append(f"    {name} {{ {does} faces ({face}); }}\n")
    counts = " ".join(map(str, case.cells.tolist()))
    return (
        f"vertices\n(\n{vertices});\n"
        f"blocks\n(\n    hex (0 1 2 3 4 5 6 7) ({counts}) simpleGrading (1 1 1)\n);\nedges ();\nboundary\n(\n"
        f"{''.join(patches)});\nmergePatchPairs ();\n"
    )


def _snappy(case: Case) -> str:
    names = surfaces(case)
    # What fields say of the group holds for each patch in it.
    groups = {"grains": " inGroups (grains);"} if case.per_grain else {}
    geometry = "".join(f"    {name}.stl {{ type triSurfaceMesh; name {name}; }}\n" for name in names)
    features = "".join(f'        {{ file "{name}.eMesh"; level {case.level}; }}\n' for name in names)
    refined = "".join(
        f"        {name} {{ level ({case.level} {case.level}); patchInfo {{ type wall;{groups.get(name, '')} }} }}\n"
        for name in names
    )
    return (
        f"castellatedMesh true;\nsnap true;\naddLayers false;\ngeometry\n{{\n{geometry}}}\n"
        "castellatedMeshControls\n{\n"
        "    maxLocalCells 20000000;\n    maxGlobalCells 100000000;\n    minRefinementCells 0;\n"
        "    nCellsBetweenLevels 2;\n    resolveFeatureAngle 30;\n    allowFreeStandingZoneFaces true;\n"
        f"    features\n    (\n{features}    );\n"
        f"    refinementSurfaces\n    {{\n{refined}    }}\n    refinementRegions {{}}\n"
        # Two names for one thing: the second is the Foundation's since version 11.
        f"    locationInMesh {_vector(case.void_point)};\n    insidePoint {_vector(case.void_point)};\n}}\n" + _SNAPPY
    )


def _features(case: Case) -> str:
    return "".join(
        f"{name}.stl\n{{\n    extractionMethod extractFromSurface;\n    includedAngle 150;\n"
        "    extractFromSurfaceCoeffs { includedAngle 150; }\n    writeObj no;\n}\n"
        for name in surfaces(case)
    )


def _features_foundation(case: Case) -> str:
    names = " ".join(f'"{name}.stl"' for name in surfaces(case))
    return f"surfaces ({names});\nincludedAngle 150;\nwriteObj no;\n"


_SNAPPY = """\
snapControls
{
    nSmoothPatch 3;
    tolerance 2.0;
    nSolveIter 50;
    nRelaxIter 5;
    nFeatureSnapIter 10;
    implicitFeatureSnap false;
    explicitFeatureSnap true;
    multiRegionFeatureSnap false;
}
addLayersControls
{
    relativeSizes true;
    layers {}
    expansionRatio 1.0;
    finalLayerThickness 0.3;
    minThickness 0.1;
    nGrow 0;
    featureAngle 60;
    nRelaxIter 3;
    nSmoothSurfaceNormals 1;
    nSmoothNormals 3;
    nSmoothThickness 10;
    maxFaceThicknessRatio 0.5;
    maxThicknessToMedialRatio 0.3;
    minMedianAxisAngle 90;
    minMedialAxisAngle 90;
    nBufferCellsNoExtrude 0;
    nLayerIter 50;
}
meshQualityControls
{
    maxNonOrtho 70;
    maxBoundarySkewness 3.9;
    maxInternalSkewness 3.9;
    maxConcave 80;
    minVol 1e-30;
    minTetQuality 1e-15;
    minArea -1;
    minTwist 0.02;
    minDeterminant 0.001;
    minFaceWeight 0.05;
    minVolRatio 0.01;
    minTriangleTwist -1;
    nSmoothScale 4;
    errorReduction 0.75;
    relaxed { maxNonOrtho 75; }
}
mergeTolerance 1e-6;
"""

_CONTROL = """\
application simpleFoam;
solver incompressibleFluid;
startFrom latestTime;
startTime 0;
stopAt endTime;
endTime 500;
deltaT 1;
writeControl timeStep;
writeInterval 500;
purgeWrite 1;
writeFormat binary;
writePrecision 10;
writeCompression off;
timeFormat general;
timePrecision 6;
runTimeModifiable false;
functions
{
@RATE@}
"""

_RATE = """\
    flowRate
    {
        type surfaceFieldValue;
        libs (fieldFunctionObjects);
        fields (phi);
        operation sum;
        regionType patch;
        name outlet;
        select patch;
        patch outlet;
        writeFields false;
        log false;
        writeControl timeStep;
        writeInterval 1;
    }
"""

_DRIFT = """\
    drift
    {
        type volFieldValue;
        libs (fieldFunctionObjects);
        fields (U);
        operation volIntegrate;
        regionType all;
        select all;
        cellZone all;
        writeFields false;
        log false;
        writeControl timeStep;
        writeInterval 1;
    }
"""

_SCHEMES = """\
ddtSchemes { default steadyState; }
gradSchemes { default Gauss linear; }
divSchemes
{
    default none;
    div(phi,U) bounded Gauss linearUpwind grad(U);
    div((nuEff*dev2(T(grad(U))))) Gauss linear;
}
laplacianSchemes { default Gauss linear limited corrected 0.5; }
interpolationSchemes { default linear; }
snGradSchemes { default limited corrected 0.5; }
"""

_SOLUTION = """\
solvers
{
    p { solver GAMG; smoother GaussSeidel; tolerance 1e-14; relTol 0.02; }
    U { solver smoothSolver; smoother symGaussSeidel; tolerance 1e-14; relTol 0.02; }
}
SIMPLE
{
    consistent yes;
    nNonOrthogonalCorrectors 1;
    pRefCell 0;
    pRefValue 0;
    residualControl { p 1e-5; U 1e-5; }
}
relaxationFactors
{
    fields { p 0.9; }
    equations { U 0.9; }
}
"""

_ALLRUN = """\
#!/bin/sh
# Mesh the void and drive fluid through it: ./Allrun, or ./Allrun N for N processes.
cd "${0%/*}" || exit 1
set -e
n=${1:-1}

# Debian's package does not set it.
if [ -z "$WM_PROJECT_DIR" ] && [ -d /usr/share/openfoam ]; then
    WM_PROJECT_DIR=/usr/share/openfoam
    export WM_PROJECT_DIR
fi

run() {
    log="log.$1"
    echo "Running $*"
    "$@" > "$log" 2>&1 || { tail -n 20 "$log"; exit 1; }
}
run_on_all() {
    if [ "$n" -gt 1 ]; then
        log="log.$1"
        echo "Running $* on $n processes"
        mpirun $([ "$(id -u)" -eq 0 ] && echo --allow-run-as-root) -np "$n" "$@" -parallel > "$log" 2>&1 ||
            { tail -n 20 "$log"; exit 1; }
    else
        run "$@"
    fi
}

rm -rf 0 [1-9]* processor* postProcessing constant/polyMesh log.*

# ESI's versions read constant/triSurface, the Foundation's constant/geometry.
mkdir -p constant/geometry
cp constant/triSurface/*.stl constant/geometry/

run blockMesh
if command -v surfaceFeatureExtract > /dev/null; then
    run surfaceFeatureExtract
else
    run surfaceFeatures
fi
run snappyHexMesh -overwrite
run checkMesh
for patch in @ENDS@; do
    # Too coarse a mesh closes the throats between grains: what is left around the point is a pocket.
    if ! sed -n "/^ *$patch\\$/,/}/p" constant/polyMesh/boundary | grep -q 'nFaces *[1-9]'; then
        echo "The mesh reaches no $patch: it is too coarse for the throats." >&2
        echo "Export the case with more cells, or with a level above 0." >&2
        exit 1
    fi
done
if ! grep -q '^Mesh OK' log.checkMesh; then
    echo "checkMesh finds the mesh unsound:" >&2
    sed -n 's/^ *[*][*][*]//p' log.checkMesh >&2
    echo "Export the case with more cells, another gap or another treatment of contacts." >&2
    exit 1
fi
cp -r 0.orig 0
if [ "$n" -gt 1 ]; then
    sed -i "s/^numberOfSubdomains .*/numberOfSubdomains $n;/" system/decomposeParDict
    run decomposePar
fi
if command -v foamRun > /dev/null; then
    run_on_all foamRun
else
    run_on_all simpleFoam
fi
if [ "$n" -gt 1 ]; then
    run reconstructPar -latestTime
fi
"""
