"""The names that users may rely on; a change here is a change of the public interface."""

import importlib

import pytest

PUBLIC = {
    "sim.types": ["Action", "Camera", "EpisodeKey", "Frame", "GridSpec", "Observation", "Pose", "Task"],
    "sim.errors": ["AgentError", "DatasetError", "PersonalVizError", "RunFileError", "SceneError", "StudyError"],
    "sim.episodes.dataset": ["PersonalDataset"],
    "sim.episodes.schema": ["Episode", "EpisodeRecord", "Goal", "SceneFile", "ViewPoint"],
    "sim.episodes.validate": ["validate_dataset"],
    "sim.authoring.generation": ["invent_dataset"],
    "sim.copies.browser_glb": ["browser_glb", "glb_from_mesh"],
    "sim.copies.cut": ["cut_storey", "storey_cut", "storey_mesh"],
    "sim.mesh": ["Scene", "TriangleMesh"],
    "sim.homes.open_home": ["open_scene"],
    "sim.walk.navigation_map": ["NavigationMap", "StepResult", "TopDown"],
    "sim.render.renderer": ["Hits", "Renderer"],
    "sim.walk.floor_grid": ["FloorGrid", "floor_grid_from_mesh"],
    "sim.render.raycast": ["Raycaster"],
    "sim.tasks.pan": ["PanEnv"],
    "sim.tasks.agents": ["Agent"],
    "sim.tasks.rules": ["score_answer", "score_run", "success_region"],
    "sim.tasks.metrics": ["MetricRow", "metric_rows"],
    "sim.tasks.run_files": ["Answer", "EpisodeRun", "Run", "read_run"],
    "sim.tasks.run_writer": ["RunWriter"],
    "grounding.types": ["FeatureMap", "Grounding"],
    "grounding.methods.rpg": ["rpg_dense", "rpg_packed"],
    "grounding.checks": [
        "check_detector",
        "check_encoder",
        "check_grounder",
        "check_image_encoder",
        "check_map_builder",
        "check_phrases",
        "check_scorer",
        "check_segmenter",
    ],
    "grounding.encoders.by_name": ["make_encoder", "make_image_encoder"],
    "grounding.encoders.protocol": ["DenseEncoder", "TextEncoder", "TextImageEncoder"],
    "grounding.evaluation.evaluate": ["GroundSettings", "SceneGrounder"],
    "grounding.agents.explore": ["Exploration", "explore", "frames_of"],
    "grounding.methods.by_name": ["Grounder", "make_grounder"],
    "grounding.maps.files": ["load_memory", "save_memory"],
    "grounding.maps.grid_map": ["GridMapBuilder", "MapBuilder"],
    "grounding.maps.home_map": ["HomeMemory", "ObjectMap", "StoreyMemory"],
    "grounding.maps.object_map": ["ObjectMapBuilder"],
    "grounding.perception.by_name": ["make_perception"],
    "grounding.perception.oracle_view": ["oracle_perception_of"],
    "grounding.perception.protocol": ["Detector", "ImageTextScorer", "Perception", "Segmenter"],
    "grounding.phrases.sources": ["PhraseSource", "make_phrases"],
    "human_study.export.study_export": ["export_study"],
    "human_study.export.verify": ["verify_trial"],
    "sim.tasks.observers": ["Detection", "Explains", "Insight", "Observer"],
    "recordings.replay": ["log_comparison"],
    "recordings.read": ["read_rrd"],
    "recordings.observer": ["RerunObserver"],
    "recordings.habitat_writer": ["RunWriter"],
}


@pytest.mark.parametrize("module", PUBLIC)
def test_public_names_are_there_and_documented(module: str) -> None:
    loaded = importlib.import_module(module)
    for name in PUBLIC[module]:
        assert getattr(loaded, name).__doc__, name
