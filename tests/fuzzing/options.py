"""Good and bad values of the command line's arguments and options."""

from __future__ import annotations

from .mutate import NAMES, NUMBERS

BAD_NUMBERS = (*NUMBERS, "1e1000000", "9" * 5000, "nan(1)", "0b1", "１e5", "- 1", "0.1,0.2", "a")
HUGE = ("9223372036854775807", "9223372036854775808", "10" * 40, "1" * 5000, "1e9", "-1", "0",
        "1.5", "", "nan", "１２", "1_000", "4294967296x4294967296", "2000001x2", "0x10", "x", "1x1",
        "3x", "x3", "3xx3", "99999999999999999999", "7x7x7x7x7x7x7x7x7x7")  # fmt: skip

COMMANDS: dict[str, tuple[str, ...]] = {
    "robots": (),
    "train": ("robot?", "--data", "-o!", "--joints", "--tip", "--lock", "--range", "--map",
              "--motor-size", "--sensory-size", "--rule", "--epochs", "--sigma", "--noise",
              "--seed", "--motion", "--change", "--columns", "--unit", "--prismatic"),
    "query forward": ("model", "numbers", "--readout", "--input", "--output"),
    "query inverse": ("model", "numbers", "--readout", "--near", "--all", "--input", "--output"),
    "query path": ("model", "--input!", "--output", "--from", "--step"),
    "evaluate": ("model", "--data", "--columns"),
    "check": ("model", "--data!", "--columns", "--unit"),
    "adapt": ("model", "--data!", "-o", "--method", "--columns", "--unit"),
    "correct": ("model", "--input!", "--output"),
    "urdf": ("model", "-o!"),
    "babble": ("robot", "-o!", "--samples!", "--joints", "--tip", "--lock", "--range", "--noise",
               "--seed", "--motion", "--change"),
    "log": ("bag", "-o!", "--joints-topic", "--tip-topic", "--joints", "--max-gap", "--still",
            "--time-offset"),
    "preview": ("model", "--html!", "--data", "--columns", "--meshes", "--port"),
    "info": ("model",),
    "plan": ("either", "-o!", "--poses!", "--joints", "--tip", "--lock", "--range", "--margin",
             "--from", "--data", "--columns", "--seed"),
}  # fmt: skip
RARE = {"report": ("model", "-o!", "--data"), "reproduce": ("subject", "-o!", "--seed")}
LONG = {"report": 20.0, "reproduce": 60.0}  # s; a dozen figures are work and no hang
WORKING = ("train", "train", "babble", "query inverse", "query forward", "query path", "adapt")
OF_LOGS = ("--data", "--columns", "--unit", "--prismatic")
NO_DEGREES = ("robots", "urdf", "log", "preview", "reproduce", "report")

FILES = ("polar", "scara", "three_link", "bad.calib", "bad.csv", "bad.urdf", "m.calib", "log.csv", "log.parquet", "x.csv", "q.csv",  # noqa: E501
         "far.csv", "r.urdf", "folder", "none", "/dev/null", "/dev/full", "/dev/zero", "-",
         "folder/none/x", "/proc/self/mem", "/nonexistent/x.csv", "x" * 250 + ".csv")  # fmt: skip
_LOGS = ("log.csv", "log.csv", "bent.csv", "log.parquet", "bad.csv")
_OUT = ("out.csv", "out.calib", "new.parquet", "folder/out.html", "out.urdf", "m.calib", "log.csv")
_BAD_OUT = ("/dev/full", "folder", "none/x", "/proc/x", "", "x" * 300, "\0", "-", "/", "bad.csv",
            "~/x", "a\nb", "out.CSV", "CON", "/dev/null", ".", "folder/")  # fmt: skip
_PAIRS = ("0.5,1", "1,1", "0.5,1.0,0.2", "0.1,0.1")
VALUES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "--data": (_LOGS, FILES),
    "--input": (("q.csv", "x.csv", "far.csv", "log.csv", "-"), FILES),
    "--output": (_OUT, _BAD_OUT),
    "-o": (_OUT, _BAD_OUT),
    "--html": (("p.html",), _BAD_OUT),
    "--joints": (("shoulder,elbow", "elbow,shoulder"), ("a", "a,a", ",", *NAMES)),
    "--tip": (("tip", "forearm"), NAMES),
    "--lock": (("elbow=1.5", "shoulder=1"), ("elbow=nan", "=", "a=b=1", "elbow=1e308", *NAMES)),
    "--range": (("elbow=0.5:1.5", "shoulder=0.1:1.1"),
                ("elbow=1:0", "elbow=nan:1", "elbow=-1e308:1e308", "elbow=1:1", "elbow=0.5:inf",
                 "=1:2", "elbow=0.5:0.5000000001", "a=1:2", *NAMES)),
    "--map": (("vdsom", "som", "dsom", "vdsom:rho", "gas"), ("vdsom:", "vdsom:x", ":", *NAMES)),
    "--motor-size": (("3", "4x3"), HUGE),
    "--sensory-size": (("3", "4x3"), HUGE),
    "--rule": (("batch", "online"), NAMES),
    "--epochs": (("1", "2"), HUGE),
    "--sigma": (("2:0.5", "1:1"), ("1e308:1e-308", "1:0", "nan:1", "1", ":", "1:2:3", "1e-320:1",
                                   "0.1:1e308", *NUMBERS)),
    "--noise": (("0", "0.001"), BAD_NUMBERS),
    "--seed": (("0", "7"), HUGE),
    "--samples": (("20", "5"), (*HUGE, *NUMBERS)),
    "--poses": (("5", "3"), (*HUGE, *NUMBERS)),
    "--margin": (("0.1", "5%"), (*BAD_NUMBERS, "50%", "1e308%", "-1%", "nan%")),
    "--keep": (("x=-0.5:0.5", "y=0.1:0.5"), ("x=1:0", "z=0:1", "x=nan:1", "x=1e308:1e309", *NAMES)),
    "--motion": (("uniform", "halton", "sobol", "smooth"), NAMES),
    "--change": (("elbow.length=+20%", "sensor.rotate=0.1", "shoulder.offset=0.05",
                  "sensor.mirror=x", "sensor.shift=0.1,0.2", "sensor.outliers=0.1",
                  "elbow.backlash=0.01", "elbow.noise=0.01"),
                 ("elbow.length=1e308", "sensor.scale=1e308", "sensor.scale=1e-320",
                  "sensor.shift=1e308,1e308", "elbow.gear=1e308", "elbow.noise=1e308", "a.b=c",
                  "elbow.length=nan", "elbow.length=+-20%", "elbow.length=-100%", "=", ".=", *NAMES,
                  "sensor.outliers=1e-320", "tip.offset=1e308,0", "elbow.gear=1e-320",
                  "shoulder.offset=1e308", "elbow.length=+1e308%", "elbow.lock=1.0")),
    "--columns": (("x=x,y=y",), ("x=y", "x=", "=x", "x=x,x=y", "q=x", "x=y,y=x", *NAMES)),
    "--unit": (("m", "mm", "px"), NAMES),
    "--prismatic": (("elbow",), NAMES),
    "--readout": (("local", "activity", "winner"), NAMES),
    "--near": (_PAIRS, (*BAD_NUMBERS, "nan,1", "1e308,1e308", ",", "1,2,3,4")),
    "--from": (_PAIRS, (*BAD_NUMBERS, "nan,1", "1e308,1e308", ",", "1,2,3,4")),
    "--step": (("0.01", "0.1", "inf"), BAD_NUMBERS),
    "--all": ((), ()),
    "--method": (("few-shot", "online"), NAMES),
    "--joints-topic": (("/joint_states",), NAMES),
    "--tip-topic": (("/tip",), NAMES),
    "--max-gap": (("0.1",), BAD_NUMBERS),
    "--still": (("0.1",), BAD_NUMBERS),
    "--time-offset": (("0.1",), BAD_NUMBERS),
    "--meshes": (("folder",), NAMES),
    "--port": (("0", "8080"), HUGE),
}  # fmt: skip
