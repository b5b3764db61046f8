"""Notes on the sources of grounding figures: the map's texts, the phrases, and the paper's figures on its own maps.

Every table of POG figures, in every form, takes its line about sources from here.
"""

from collections.abc import Iterable, Mapping, Sequence

from sim.tasks.run_files import RunInfo

from ..encoders.protocol import ORACLE_SUFFIX, TEXT_ENCODERS

PAPER_IS = "paper's HM3D maps"
"""Name of a row or column with the paper's figures."""
PAPER_POG: dict[str, tuple[float, float, float, float]] = {
    "random": (0.5, 0.3, 0.4, 0.4),
    "center": (1.2, 0.8, 1.0, 1.0),
    "qs": (15.4, 12.7, 8.6, 11.9),
    "rpg": (25.3, 23.6, 15.2, 16.8),
    "human": (95.3, 89.1, 83.4, 87.0),
}
"""Easy, medium, hard, total in percent (paper, POG Results); people had the scans' GLB files. RPG's total is as
printed, although the mean of its splits is 21.4."""
_NOT_COMPARABLE = (
    "Not comparable with the paper: its maps were made by a vision model from renders of HM3D; oracle maps hold the "
    "captions of the same episode files that the queries come from (circular). They rank methods and do not predict "
    "success on maps that a camera saw."
)
_PHRASES = {
    "dataset": "dataset = the episode files' own (ground truth)",
    "rules": "rules = read from the description by rules",
    "llm": "llm = read from the description by a language model",
}


def pog_notes(infos: Sequence[RunInfo]) -> tuple[str, ...]:
    """The notes beside the POG figures of runs on one kind of map, in every form; empty for people alone.

    They say where the map's texts, the phrases and the storey come from, and which methods have a row with the
    dataset's phrases but none with phrases read by rules. On oracle maps they give the paper's figures and say why they
    cannot be compared.
    """
    agents = [info for info in infos if info.who_kind == "agent"]
    if not agents:
        return ()
    words = list(dict.fromkeys(_words_line(info.config) for info in agents))
    sources = {name: [info.who for info in agents if info.config.get("phrases") == name] for name in _PHRASES}
    used = [text for name, text in _PHRASES.items() if sources[name]]
    lines = [" ".join([*words, *([f"Phrases: {'; '.join(used)}."] if used else [])])]
    alone = sorted(set(sources["dataset"]) - set(sources["rules"]))
    if alone:
        lines.append(f"No row with phrases read by rules for {', '.join(alone)}: personal-viz ground --phrases rules.")
    if any(info.scene_kind == "oracle-map" for info in agents):
        lines.append(_paper_line([info.who for info in infos]))
    return tuple(lines)


def _words_line(options: Mapping[str, object]) -> str:
    encoder = str(options.get("encoder", "unknown"))
    text_encoder = encoder.removesuffix(ORACLE_SUFFIX)
    if options.get("map") == "oracle":
        words = "captions of the same episode files (circular)"
    elif text_encoder in TEXT_ENCODERS or text_encoder != encoder:
        words = f"captions of the same episode files for what the camera saw (oracle perception, {text_encoder})"
    else:
        words = f"none, vectors of pictures (encoder {encoder})"
    return f"Map words: {words}. Target's storey: {'not given' if options.get('all_storeys') else 'given'}."


def _paper_line(methods: Iterable[str]) -> str:
    known = [name for name in dict.fromkeys(methods) if name in PAPER_POG]
    figures = [f"{name} {' / '.join(f'{value:.1f}' for value in PAPER_POG[name])}" for name in known]
    printed = f"{PAPER_IS} (easy / medium / hard / total): {', '.join(figures)}. " if figures else ""
    return printed[:1].upper() + printed[1:] + _NOT_COMPARABLE
