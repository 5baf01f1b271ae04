"""A finished run of the trainer as a run of MLflow, in a file of this machine: no server is asked.

    pip install mlflow-skinny sqlalchemy alembic
    python python/examples/mlflow_run.py --run out/learned --store out/mlflow.db
    mlflow ui --backend-store-uri sqlite:///out/mlflow.db        # with the whole package, mlflow
"""

import argparse
import csv
import json
import pathlib

import mlflow


def keys(values: dict[str, object], name: str = "") -> dict[str, object]:
    """Sections as dotted names."""
    flat: dict[str, object] = {}
    for key, value in values.items():
        dotted = f"{name}.{key}" if name else key
        flat |= keys(value, dotted) if isinstance(value, dict) else {dotted: value}
    return flat


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", type=pathlib.Path, required=True, help="folder of the run")
    parser.add_argument("--store", type=pathlib.Path, default=pathlib.Path("out/mlflow.db"))
    args = parser.parse_args()
    told = json.loads((args.run / "run.json").read_text())
    report = json.loads((args.run / "report.json").read_text())
    mlflow.set_tracking_uri(f"sqlite:///{args.store.absolute()}")
    mlflow.set_experiment(report["algorithm"])
    with mlflow.start_run(run_name=args.run.name):
        mlflow.log_params({"seed": told["seed"]} | keys(told["configuration"]))
        with open(args.run / "metrics.csv", newline="") as file:
            for row in csv.DictReader(file):
                known = {name.replace("/", "."): float(value) for name, value in row.items() if value}
                mlflow.log_metrics(known, step=int(row["episode"]))
    print(f"{report['episodes']} episodes of {args.run} in {args.store}")


if __name__ == "__main__":
    main()
