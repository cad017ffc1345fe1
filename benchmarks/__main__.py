"""`python -m benchmarks NAME`: one folder a benchmark, imported only when it is asked for."""

import argparse
import importlib
import sys

from fpjax import InputError

NAMES = {
    "thesis": "every printed cell of the thesis, as printed / obtained / verdict, and its figures",
    "compare": "Algorithm 1, sweep, gradient and Nelder-Mead at the same objective and budget",
    "defaults": "what tune finds from an untouched file, against the best of many starts",
    "speed": "fpjax against a C++ loop and its peers, with the goals' table",
    "starts": "whether the diagnosis' own starts lead to the fit that begins at the true values",
    "withheld": "the diagnosis on simulated logs whose effect is withheld, by two generators",
    "plan": "whether a planned run decides what an ambiguous log left open, against a generic one",
    "improve": "gains by improve against gains tuned in the nominal model and in the truth, run in the truth",
    "real": "the diagnosis on records of real machines whose cause is documented",
}


def main(argv: list[str] | None = None) -> int:
    """Run one benchmark; returns the exit code (0, or 2 after one sentence on bad input)."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    commands = parser.add_subparsers(dest="name", required=True, metavar="NAME")
    argv = sys.argv[1:] if argv is None else argv
    chosen = next((word for word in argv if not word.startswith("-")), None)
    for name, summary in NAMES.items():
        # Every benchmark is listed in the help, but only the chosen one is imported: most of them import jax.
        command = commands.add_parser(name, help=summary, description=summary)
        if name == chosen:
            importlib.import_module(f"benchmarks.{name}.command").add_arguments(command)
    arguments = parser.parse_args(argv)
    try:
        return importlib.import_module(f"benchmarks.{arguments.name}.command").run(arguments)
    except InputError as error:
        print(f"benchmarks {arguments.name}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"benchmarks {arguments.name}: interrupted", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
