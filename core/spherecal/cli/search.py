"""The options of the search through the camera graph, which `calibrate`, `batch` and `study` share."""

import argparse

from spherecal.initialise.path import BASE, Search


def add_search(parser: argparse.ArgumentParser) -> None:
    """What the paper's method is compared with: none-OPT in two orders, Dijkstra, none-SPO."""
    parser.add_argument("--no-opt", action="store_true", help="none-OPT: the first path that reaches a camera")
    parser.add_argument(
        "--no-opt-listed", action="store_true", help="none-OPT in the literal order of Algorithm 3: triples by number"
    )
    parser.add_argument("--dijkstra", action="store_true", help="shortest paths instead of A*")
    parser.add_argument(
        "--no-spo", action="store_true", help="none-SPO: no spherical projection (changes --method tao2021 alone)"
    )


def search_of(options: argparse.Namespace) -> Search:
    """The search that was asked for."""
    if options.no_opt_listed:
        return "first-listed"
    return "first" if options.no_opt else "dijkstra" if options.dijkstra else "opt"


def add_path_weights(parser: argparse.ArgumentParser) -> None:
    """xi1, xi2, TH_er and b of [Tao21] (10)-(14)."""
    parser.add_argument(
        "--path-weights",
        type=float,
        nargs=2,
        default=(1.0, 1.0),
        metavar=("XI1", "XI2"),
        help="of the reprojection error and of one over the common features in an edge of the graph (default 1 1)",
    )
    parser.add_argument(
        "--path-error",
        type=float,
        metavar="PX",
        help="TH_er: the mean reprojection error in a triple beyond which an edge is refused (default: 5 x the median)",
    )
    parser.add_argument(
        "--path-base", type=float, default=BASE, metavar="B", help=f"b: what a further camera costs (default {BASE})"
    )
