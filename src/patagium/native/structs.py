"""Structures and numbers that Python and the hand-written kernels share: one table for both.

A structure is a text of one line a field, `C declaration: meaning`. From it come the class of
ctypes and the text of a C header, `<name>_struct.h`, that is put beside a kernel when it is
compiled (`compiler.load_kernel`). All memory is owned by Python, zero to begin with, filters'
arrays on cache lines. REAL is the precision of a filter's points, STORE that of a precision.
"""

from __future__ import annotations

import ctypes
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

from patagium.errors import CompilerError

_SCALARS: dict[str, Any] = {
    "int32_t": ctypes.c_int32,
    "int64_t": ctypes.c_int64,
    "double": ctypes.c_double,
}
_FUNCTIONS = {
    "function": "void (*function)(const double *const *, double *const *)",
    "learn_function": "int (*learn_function)(void *)",
    "recall_function": "void (*recall_function)(void *, double)",
    "settle_function": "void (*settle_function)(void *, int)",
    "run_function": "int64_t (*run_function)(void *, int64_t, const double *, double *)",
}
"""Types of functions: compiled ones of one point; of filters, memories, pipelines."""


def header_numbers(name: str) -> SimpleNamespace:
    """Numeric constants (`#define`) of a C header in `kernels/`, by name."""
    text = (Path(__file__).parent / "kernels" / name).read_text("utf-8")
    found = re.findall(r"^#define (\w+) (\d\S*)", text, re.MULTILINE)
    return SimpleNamespace(**{key: float(value) for key, value in found})


class Field(NamedTuple):
    """Field of a structure.

    Attributes:
        declaration: Its declaration in C, without semicolon.
        meaning: What it holds, with its shape.
    """

    declaration: str
    meaning: str

    @property
    def name(self) -> str:
        """Name of the field."""
        return self.declaration.split()[-1].lstrip("*")

    @property
    def type(self) -> str:
        """Type of a field that is no pointer; "void *" of a pointer or function."""
        kind = self.declaration.rpartition(" ")[0]
        return "void *" if "*" in self.declaration or kind in _FUNCTIONS else kind


class Struct(NamedTuple):
    """Structure shared by Python and C.

    Attributes:
        name: Its name in C.
        fields: Its own fields in order.
        type: Class of ctypes.
        base: Name of the structure whose fields come before; in C also as the field `base`.
    """

    name: str
    fields: tuple[Field, ...]
    type: Any
    base: str = ""

    @property
    def header(self) -> str:
        """Text of the C header that declares the structure."""
        guard = f"PATAGIUM_{self.name.upper()}_STRUCT_H"
        lines = [f"  {field.declaration}; /* {field.meaning} */" for field in self.fields]
        if self.base:
            own = f"{self.base.upper()}_FIELDS"
            lines.insert(0, f"  union {{ {self.base} base; struct {{ {own} }}; }};")
        fields = " ".join(f"{field.declaration};" for field in self.fields)
        types = [f"typedef {text};" for text in _FUNCTIONS.values()]
        parts = [
            "/* Generated from native/structs.py: change it there. */",
            f"#ifndef {guard}\n#define {guard}\n#include <stdint.h>",
            *types,
            "typedef struct {",
            *lines,
            f"}} {self.name};",
            f"#define {self.name.upper()}_FIELDS {fields}\n#endif\n",
        ]
        return "\n".join(parts)


def struct(name: str, text: str, *others: Struct, base: Struct | None = None) -> Struct:
    """Structure of a table.

    Args:
        name: Its name in C.
        text: One line a field: `declaration: meaning`.
        *others: Structures that are fields of this one.
        base: Structure whose fields come before, all of them of eight bytes in the end.

    Raises:
        CompilerError: If a field has a type that is not known.
    """
    lines = (line.partition(": ") for line in text.splitlines() if line.strip())
    found = tuple(Field(declaration.strip(), meaning) for declaration, _, meaning in lines)
    known = _SCALARS | {"void *": ctypes.c_void_p} | {one.name: one.type for one in others}
    for field in found:
        if field.type not in known:
            raise CompilerError(f"field {field.name} of {name}: unknown type {field.type!r}")
    members: dict[str, Any] = {"_fields_": [(field.name, known[field.type]) for field in found]}
    parent = ctypes.Structure if base is None else base.type
    return Struct(name, found, type(name, (parent,), members), "" if base is None else base.name)


BOUNDS = struct(
    "bounds",
    """
    int64_t inputs: n_x that are measured; arrays hold n: those, then the outputs
    int64_t smooth: of them that do not jump: all but accelerations
    int64_t coordinates: number of q among them, the first; 0 where they are no state
    int64_t dof: number of v, which follow
    const double *x: n_x: inputs of this sample
    const double *scale: n: of each channel before it is known
    double *low: n: least value of the range
    double *high: n: largest value of the range
    double *before: n: last value taken
    double *step: n: median absolute step
    double *odd: n: last value refused
    double *odd_low: n: least of those refused of late
    double *odd_high: n: largest of those refused of late
    double *seen: n: last inputs, refused or not
    double *rest: n: longest rest of late, in samples
    int64_t *taken: n: values taken that moved
    int64_t *odd_run: n: values refused of late, less those taken
    int64_t *stood: n: samples in a row that did not move while an input did
    double *clock: stamp of the last sample taken, usual step, samples refused since then
    double *track: samples taken smoothly one after the other, whether one jumped since the last
    """,
)

SCREENING = struct(
    "screening",
    """
    int32_t channels: m, number of channels
    int32_t stuck_samples: repeated values after which a channel is left out; 0: never
    int32_t window: samples tested for a change; 0: changes are not looked for
    int32_t reference: samples before them
    double limit: largest innovation in standard deviations; infinite: any
    double share: of a sample in the estimated variance; 0: the variance is known
    double ratio: of the mean in the window over that before, at an alarm
    double *numbers: 5
    int64_t *whole: 5
    int64_t *counts: of each event
    double *noise: m: variance at this sample
    double *steady: m: its part that is always there
    double *loaded: m: its part that goes with the load, over the mean load
    double *smallest: m: neither part falls below
    double *load: m: squared norm of the channel's row of the readout, now
    double *mean_load: m
    double *extra: m: added to the noise of this sample
    double *last: m: measured before
    int64_t *still: m: samples that repeated it
    int64_t *moved: m: whether the channel ever changed
    int64_t *left_out: m
    double *past: window + reference
    double *stated: m: variance that this sample has on top, where the rest is estimated
    double relative: standard deviation to start from over an output's scale; 0: it is known
    double *offset: m: value of y that its scale is about
    double *scale: m: mean square distance of the measurements from it so far
    double *largest: m: largest scale that the noise grew with
    int64_t *seen: m: samples of the channel so far
    double floor: error of the model at least, over the deviation of each output; 0: there is none
    double span: samples in a span of correlation
    double least: variance of a scaled output, at least
    double *clock: stamp of the sample before, NaN: unknown; mean time between two, 0: unknown
    double *left: m: what the last sample left
    double *carried: m: what of it is expected at this sample
    double *lagged: m: mean product of an innovation and of what the sample before left
    double *power: m: mean square of what the sample before left
    double *center: m: mean of the measurements
    int32_t strips: number of strips whose forces the outputs tell
    double *spread: m x strips: from the square of a strip's force to that of an output
    double *told: m x strips: from the square of an output to that of a strip's force
    double *sampled: m: mean variance that came with the samples of late
    double *level: m: variance of the measurements
    double *change: m: mean square of their changes from sample to sample
    double *before: m: measured before, with or without screening
    double *residual: m: mean square of what a sample leaves
    double *recent: m: mean square of the errors of late
    double *alone: m: that of the weights' predictions alone
    double *width: m: logarithm of the width of the interval, so that it holds 95 %
    double *usual: m: mean variance that the weights gave of late
    double *interval: m: variance that the filter states
    int64_t *heard: m: samples of the channel so far
    int64_t *far: m: samples in a row that were too far off to be used
    bounds *bounds: of inputs and outputs, ahead of the filter
    """,
    BOUNDS,
)

WEIGHT_FILTER = struct(
    "weight_filter",
    """
    int32_t weights: n
    int32_t outputs: n_y
    int32_t stride: n_y rounded up to whole vectors
    int32_t items: evaluations of the perceptron for one y
    int32_t layers: of the perceptron
    int32_t activation: 0 softplus, 1 tanh
    const int32_t *widths: layers + 1
    double spread: distance of the points in standard deviations
    double growth: 1 / sqrt(forgetting factor)
    double curvature_gain: M = curvature_gain sum (c - centered D)(c - centered D)'
    double centered: + shift_gain D D' + diag(noise); c: half sums less the
    double shift_gain: value at the mean, D = sum c / spread^2
    double largest: no row of S is longer
    double nis: normalized innovation squared of the last sample
    double *mean: n
    double *prior: n: mean that the prior share goes back to
    double pull: share of the way there after each sample
    screening *screen: of the samples; holds the variances of the measurement
    double *small: matrices of stride x stride
    function encode: features and readout of x; NULL: they are given
    const double *const *encode_arguments: x, constants
    double *const *encode_results: features, readout
    double *features: items x widths[0]
    double *readout: items widths[layers] x n_y: transposed
    double *offset: n_y
    double *measured: n_y
    double *predicted: n_y
    double *innovation: n_y
    double *covariance: n_y x n_y
    """,
    SCREENING,
)
"""Fields of every kernel that learns a whole sample."""

PANEL_FILTER = struct(
    "panel_filter",
    """
    int32_t rows: of all blocks, each rounded up to a multiple of PANEL by zeros
    int32_t blocks: of weights whose covariance is kept
    const int32_t *starts: blocks + 1: first row of each block
    const int32_t *counts: blocks: its weights
    const int32_t *order: weights: number of each, block by block
    REAL *root: S by blocks: panels of (its rows - first column) x PANEL
    REAL *near: rows: mean in the precision of the points
    REAL *slopes: rows x stride: Z
    REAL *curvatures: rows x stride: c
    REAL *steps: rows / PANEL x outputs x PANEL: -e / sqrt(a), by panels
    REAL *shrinks: rows: 1 / sqrt(a)
    REAL *cross: rows x stride: C
    REAL *points: 2 x items x widest x PANEL: the perceptron at the points
    REAL *at_mean: 2 x layers x padded: sums and activations at the mean
    REAL *weighting: items widths[layers] x stride: readout, transposed
    double decay: P <- decay P + diag(drift) before a sample, where P is kept
    double *drift: rows: variances added before a sample
    double *kept: P by blocks, in panels as S; NULL: S is kept
    double *factor: S in double, where P is kept
    double *sensed: rows x stride: covariance of the weights with y, in double
    double *whitened: rows x stride: the same times a root of P_yy^-1
    double *linear: rows x stride: H' of the last layer's weights
    double *turned: rows x PANEL: rows of a panel of S, transposed
    """,
    base=WEIGHT_FILTER,
)

EXTENDED_FILTER = struct(
    "extended_filter",
    """
    panel_filter filter: mean, root and sample
    const int32_t *place: weights: row of each in `derivative`; NULL: in their order
    double *derivative: weights x stride: H'
    double *seeds: 2 x items widest x stride: dy / d sums of a layer, of that below
    """,
    PANEL_FILTER,
)

NODE_FILTER = struct(
    "node_filter",
    """
    int32_t drifts: 1: drift and decay act before each sample, 0: growth does
    int32_t drifted: 1: `grown` is the root before the next sample
    REAL *root: of all groups
    REAL *grown: the root after the drift, where there is one
    REAL *drift: variances added before a sample, rows of all groups
    REAL *near: mean in the precision of the points, rows of all groups
    REAL *plain: near in the order of the network, and WIDTH zeros
    REAL *steps: columns of all groups: change of a neuron's sum, (items)
    REAL *slopes: columns of all groups: 1 number where rank one, else n_y
    REAL *curvatures: columns of one group: n_y numbers
    REAL *gains: columns of one group: n_y + 1 numbers
    REAL *cross: rows of one group: n_y numbers
    REAL *outputs_at: 4 x items x widest
    REAL *towards: terms x n_y: change of y for an output of the perceptron
    REAL *at_mean: 2 x layers x items x padded
    double *directions: nodes x items x stride: y for a unit of each neuron's output
    double *centers: nodes x stride: mean of the curvatures
    double *squares: nodes: a'a where slopes are of rank one
    double *wide_small: 2 x n_y x n_y x WIDE
    """,
    base=WEIGHT_FILTER,
)

PIPELINE = struct(
    "pipeline",
    """
    int32_t columns: numbers of a packet
    int32_t coordinates: numbers of q
    int32_t dof: numbers of v, a and each force
    int32_t outputs: n_y
    function air_force: q, v, a, forces, parameters -> x, y
    const double *parameters: of the robot, and of its added mass
    learn_function update: of a filter: learns what stands in its memory
    void *memory: of the filter
    double *x: input of the filter
    double *y: n_y: measurement
    double *stamp: time of the sample
    const double *mean: n_y: prediction
    const double *covariance: n_y x n_y
    const double *nis: normalized innovation squared
    const int64_t *left_out: n_y
    const int64_t *alarm: not zero: the learner must act
    recall_function recall: rest of x from the network's memory; NULL without one
    settle_function settle: the filter is done with the sample
    void *lags: what both take
    """,
)

MOTION_SENSOR = struct(
    "motion_sensor",
    """
    int32_t kind: 0 encoder, 1 inertial unit, 2 camera
    int32_t values: measured values
    int32_t width: numbers of a sample
    int32_t bias: place of its first bias among them
    const int32_t *place: values: of an encoder's, among the estimated coordinates; -1 for none
    const double *variance: values
    const double *offset: 3: place of the frame
    const double *mount: 3 x 3: axes of the frame
    const double *parameters: of the robot
    function frame: inertial or pose, of frame_model.py
    """,
)

MOTION_FILTER = struct(
    "motion_filter",
    """
    int32_t order: levels of each coordinate
    int32_t coordinates: of the robot
    int32_t own: estimated coordinates
    int32_t states: s, of the error-state
    int32_t biases: of all inertial units
    int32_t values: of all sensors
    int64_t spare: where the second part of the work begins
    const int32_t *columns: own
    const int32_t *turn: 3: places of the attitude among the estimated; NULL where it is not
    const int32_t *base: 6: coordinates of the floating body; NULL without one
    double *density: own
    const double *walk: biases: squares
    const double *noise: order x order: root of what noise of density one adds in a second
    const void *sensors: of motion_sensor
    double *work: memory
    """,
)

MOTION_TRACK = struct(
    "motion_track",
    """
    void *filter: motion_filter
    int64_t capacity: samples of late, at most
    int64_t first: the oldest one
    int64_t count: of them
    int64_t size: numbers of an estimate
    int64_t width: of a sample, at most
    double memory: longest delay of a sample that is used
    double *time: capacity
    int32_t *sensor: capacity: number in the filter
    double *values: capacity x width
    double *estimates: capacity x size
    double *scratch: size
    double *found: of an update
    const int32_t *numbers: of each sensor of the autopilot in the filter; -1 for none
    double too_loud: normalized innovation squared of a value above which noise is too small,
    int64_t lately: in most of so many samples;
    double enlivened: density of the noise is then multiplied by this
    int64_t loud: samples above it less those below
    int64_t seen: samples since this was asked
    int64_t raised: times that the density was raised
    int64_t late: samples that came later than the memory
    int64_t refused: samples that could not be weighed
    """,
)

REGULATOR = struct(
    "regulator",
    """
    int32_t parts: of a beat
    int32_t states: of a flight
    int32_t kept: of them, without x
    int32_t lags: of all commands
    int32_t commands: n_u
    int32_t responses: of the gait
    int32_t joints: of the gait
    double period: of an interval
    double next: time of the next commands
    double turn: of the heading in a beat
    double heading: of the course
    double lead: on the circle of a turn, ahead of the time
    double center_x: of that circle
    double center_y: of that circle
    int32_t vectors: horizontal vectors of a state
    int32_t z: place of z
    int32_t yaw: place of yaw; -1 where there is none
    const int32_t *pairs: vectors x 2: places, first of x and y
    const double *along: parts x states: orbit
    const double *ahead: parts x states: change with the way ahead
    const double *travel: 3: in a beat
    const double *origin: 3
    const int32_t *places: kept: of each in a state
    const int32_t *sources: states: place of each in [q, v]; -1 where it is not measured
    const int32_t *answers: commands: first response of each
    const int32_t *chains: commands: numbers of its lags
    const double *moves: commands x responses: whether it moves a response
    const double *neutral: commands
    const double *scale: commands: response of a unit
    const double *low: commands
    const double *high: commands
    const double *fastest: commands: change in an interval
    const double *gains: parts x commands x (kept + lags + commands)
    double *before: commands: departures in force
    const double *sharpness: responses
    const double *range: 2 x responses
    const double *rates: responses
    const double *largest: joints: amplitude
    const double *room: 2 x joints: limits less means
    const double *reach: 2 x joints: of the gait about its means
    double *target: responses
    double *pieces: (responses + 3) x (2 + 5 responses)
    int64_t count: of pieces
    int64_t held: times that the last commands were held
    """,
)

AUTOPILOT = struct(
    "autopilot",
    """
    int32_t sensors: that it is given
    int32_t tracks: parts of the tracker
    int32_t dof: n
    int32_t columns: of a row
    int32_t record: numbers of a record
    int32_t learned: of them the pipeline's
    int32_t forces: numbers of the packet's forces
    int32_t every: ticks between samples that are learned
    int64_t ticks: so far
    int64_t late: ticks whose time fell
    int64_t held: ticks whose time was far ahead
    int64_t again: of them one after the other
    double time: of the last tick that counts
    double ahead: time of the last one that was far ahead
    double memory: longest step of the time
    const int32_t *widths: sensors: numbers in a row, with the stamp
    void *track: tracks of motion_track
    const int32_t *turn: 3: roll, pitch and yaw in q; NULL without a floating body
    function euler: angles, spin, its rate -> rates, second rates, slope
    run_function run: of the pipeline; NULL without a learner
    void *pipeline: what it takes first
    double *packet: time, q, v, a, forces
    void *regulator: what commands
    """,
)

_STRUCTS = (
    *(AUTOPILOT, REGULATOR, MOTION_TRACK, MOTION_SENSOR, MOTION_FILTER, PIPELINE),
    *(BOUNDS, SCREENING, WEIGHT_FILTER, PANEL_FILTER, EXTENDED_FILTER, NODE_FILTER),
)
HEADERS = {f"{one.name}_struct.h": one.header for one in _STRUCTS}
"""File name to text of the header of each structure, which any kernel can include."""
