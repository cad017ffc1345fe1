"""The test program of a law's C code, and its test vectors: a whole run on the host, a few rows on a target."""

import numpy as np

from .c_code import Code
from .law import Law
from .vectors import ULPS, Vectors

EMBEDDED = 64  # rows in the header: few enough for a microcontroller's flash

_PROGRAM = """\
/*
 * Compares @_step with the simulation: over the rows of a file of doubles given as argument, without one over those of
 * @_vectors.h. Each row: inputs, state, outputs, next state, their last places, the simulated run, its bounds.
 *
 * step: the largest difference of one step from the simulation's state, in units in the last place of its largest term
 * run:  the largest difference of a run left to itself; the largest ratio of a difference to its bound, and that
 *       difference and its row
 */
#include "@_control.h"
#include "@_vectors.h"

#include <math.h>
#include <stdio.h>
#include <time.h>

#define INPUTS {inputs}
#define STATES {states}
#define OUTPUTS {outputs}
#define COLUMNS (INPUTS + 3 * STATES + 4 * OUTPUTS)
#define MOST {ulps}

static const char *const names[OUTPUTS + STATES] = {{{names}}};
static double step_worst[OUTPUTS + STATES], run_worst[OUTPUTS], run_ratio[OUTPUTS], run_there[OUTPUTS];
static long run_row[OUTPUTS];
static double sum;

static double apart(double a, double b)
{{
    return a == b || (a != a && b != b) ? 0.0 : a != a || b != b ? HUGE_VAL : fabs(a - b);
}}

static void read_input(const double *row, @_input *in)
{{
{read_input}
}}

static void read_output(const @_output *out, double *values)
{{
{read_output}
}}

static void check(const double *row, long number, @_state *running)
{{
    const double *states = row + INPUTS;
    const double *outputs = states + STATES, *ulps = outputs + OUTPUTS + STATES;
    const double *simulated = ulps + OUTPUTS + STATES, *bounds = simulated + OUTPUTS;
    double values[OUTPUTS + STATES];
    @_state state;
    @_input in;
    @_output out;
    int i;

    read_input(row, &in);
    @_reset(&state);
{load_state}
    @_step(&state, &in, &out);
    read_output(&out, values);
{store_state}
    for (i = 0; i < OUTPUTS + STATES; i++) {{
        const double difference = apart(values[i], outputs[i]);
        const double places = difference > 0.0 ? difference / ulps[i] : 0.0;
        step_worst[i] = places <= step_worst[i] ? step_worst[i] : places; /* not a number stays */
    }}
    @_step(running, &in, &out);
    read_output(&out, values);
    for (i = 0; i < OUTPUTS; i++) {{
        const double difference = apart(values[i], simulated[i]);
        const double ratio = difference > 0.0 ? difference / bounds[i] : 0.0;
        run_worst[i] = difference > run_worst[i] ? difference : run_worst[i];
        if (!(ratio <= run_ratio[i])) {{
            run_ratio[i] = ratio;
            run_there[i] = difference;
            run_row[i] = number;
        }}
    }}
}}

int main(int argc, char **argv)
{{
    double row[COLUMNS];
    @_state running, timed;
    @_input in;
    @_output out;
    clock_t begin;
    long rows = 0, calls = 0;
    int i, failed = 0;

    @_reset(&running);
    if (argc > 1) {{
        FILE *file = fopen(argv[1], "rb");
        if (file == NULL) {{
            printf("cannot read %s\\n", argv[1]);
            return 2;
        }}
        for (; fread(row, sizeof row, 1, file) == 1; rows++)
            check(row, rows, &running);
        fclose(file);
    }} else {{
        for (; rows < @_ROWS; rows++)
            check(@_rows[rows], rows, &running);
    }}
    for (i = 0; i < OUTPUTS + STATES; i++) {{
        const int run = i < OUTPUTS;
        failed |= !(step_worst[i] <= MOST) || (run && !(run_ratio[i] <= 1.0));
        printf("%s step %.17g", names[i], step_worst[i]);
        if (run)
            printf(" run %.17g of bound %.17g by %.17g in row %ld", run_worst[i], run_ratio[i], run_there[i],
                   run_row[i]);
        printf("\\n");
    }}
    @_reset(&timed);
    begin = clock();
    while (calls < 2000000L && clock() - begin < CLOCKS_PER_SEC / 10) {{
        long j;
        for (j = 0; j < 1000; j++, calls++) {{
            read_input(@_rows[calls % @_ROWS], &in);
            @_step(&timed, &in, &out);
            sum += (double)out.torque;
        }}
    }}
    printf("rows %ld nanoseconds %.3g sum %g\\n", rows,
           1e9 * (double)(clock() - begin) / CLOCKS_PER_SEC / (double)calls, sum);
    printf(failed ? "FAILED\\n" : "passed\\n");
    return failed || rows == 0;
}}
"""


def test_program(law: Law, code: Code) -> str:
    """The text of NAME_test.c."""
    name, kind = code.name, "float" if law.precision == "float" else "double"
    kinds = {"float32": "float", "float64": "double"}
    types = [
        kinds.get(v.kind, f"{v.kind}_t" if v.kind != "bool" else "int") for v in law.program.inputs[len(law.inputs) :]
    ]
    states = list(enumerate(zip(law.states, types, strict=True)))
    text = _PROGRAM.format(
        inputs=len(law.inputs),
        states=len(law.states),
        outputs=len(law.outputs),
        ulps=f"{ULPS:.1f}",
        names=", ".join(f'"{word}"' for word in (*law.outputs, *law.states)),
        read_input="\n".join(f"    in->{word} = ({kind})row[{i}];" for i, word in enumerate(law.inputs)),
        read_output="\n".join(f"    values[{i}] = (double)out->{word};" for i, word in enumerate(law.outputs)),
        load_state="\n".join(f"    state.{word} = ({each})states[{i}];" for i, (word, each) in states)
        or "    (void)states;",
        store_state="\n".join(f"    values[OUTPUTS + {i}] = (double)state.{word};" for i, (word, _) in states),
    )
    return text.replace("@_ROWS", f"{name.upper()}_ROWS").replace("@", name)


def vector_header(law: Law, code: Code, vectors: Vectors) -> str:
    """The text of NAME_vectors.h: the first rows, exact to the bit."""
    rows = vectors.rows[:EMBEDDED]
    lines = [f"    {{{', '.join(_exact(value) for value in row)}}}," for row in rows]
    name, guard = code.name, f"{code.name.upper()}_VECTORS_H"
    return "\n".join(
        [
            f"/* The first samples of the simulated run, see {name}_test.c. */",
            f"#ifndef {guard}\n#define {guard}\n",
            "#include <math.h>\n",
            f"#define {name.upper()}_ROWS {len(rows)}",
            f"static const double {name}_rows[{len(rows)}][{rows.shape[1]}] = {{",
            *lines,
            "};",
            f"\n#endif /* {guard} */\n",
        ]
    )


def vector_file(vectors: Vectors) -> bytes:
    """The bytes of NAME_vectors.bin: every row, doubles of this machine."""
    return np.ascontiguousarray(vectors.rows, dtype=np.float64).tobytes()


def _exact(value: float) -> str:
    if np.isfinite(value):
        return float(value).hex() if value else "0"
    return "NAN" if np.isnan(value) else "HUGE_VAL" if value > 0 else "-HUGE_VAL"
