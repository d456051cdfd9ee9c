"""The bodies of requests and answers, as OpenAPI describes them: every field with its unit and an example."""

from service.http.wire.bodies.asked import (
    Export,
    ExportBody,
    NewCampaign,
    NewLoop,
    NewRun,
    OfDataset,
    RegressionAsked,
    Resume,
    ResumeBody,
    TakeLease,
    TakeLeaseOver,
    TargetsToCorrect,
    ToJudge,
    Why,
    WhyBody,
)
from service.http.wire.bodies.campaign import CampaignTable
from service.http.wire.bodies.cell import (
    Campaigns,
    CampaignShown,
    CellShown,
    Datasets,
    DatasetShown,
    Health,
    LeaseShown,
)
from service.http.wire.bodies.deletions import Deletions, DeletionShown
from service.http.wire.bodies.examination import ExaminationShown
from service.http.wire.bodies.exports import ExportKind, ModelExport
from service.http.wire.bodies.jobs import (
    AlignmentShown,
    DiagnosisShown,
    IdentificationShown,
    JobKept,
    JobShown,
    JobsShown,
    PlacementsShown,
    ProblemKept,
    RegressionShown,
    SelectionShown,
    ValidationShown,
)
from service.http.wire.bodies.models import ModelShown
from service.http.wire.bodies.placements import PlacementsAsked
from service.http.wire.bodies.problem import ProblemShown
from service.http.wire.bodies.runs import (
    EventKind,
    EventShown,
    LoopKept,
    Loops,
    LoopShown,
    Prompts,
    PromptShown,
    Runs,
    RunShown,
)
from service.http.wire.bodies.selections import SelectionAsked
from service.http.wire.bodies.targets import CorrectedProgram, CorrectedTargets
from service.http.wire.bodies.told import Answered, Body
from service.http.wire.bodies.validations import ValidationAsked

__all__ = [
    "AlignmentShown",
    "Answered",
    "Body",
    "CampaignShown",
    "CampaignTable",
    "Campaigns",
    "CellShown",
    "CorrectedProgram",
    "CorrectedTargets",
    "DatasetShown",
    "Datasets",
    "DeletionShown",
    "Deletions",
    "DiagnosisShown",
    "EventKind",
    "EventShown",
    "ExaminationShown",
    "Export",
    "ExportBody",
    "ExportKind",
    "Health",
    "IdentificationShown",
    "JobKept",
    "JobShown",
    "JobsShown",
    "LeaseShown",
    "LoopKept",
    "LoopShown",
    "Loops",
    "ModelExport",
    "ModelShown",
    "NewCampaign",
    "NewLoop",
    "NewRun",
    "OfDataset",
    "PlacementsAsked",
    "PlacementsShown",
    "ProblemKept",
    "ProblemShown",
    "PromptShown",
    "Prompts",
    "RegressionAsked",
    "RegressionShown",
    "Resume",
    "ResumeBody",
    "RunShown",
    "Runs",
    "SelectionAsked",
    "SelectionShown",
    "TakeLease",
    "TakeLeaseOver",
    "TargetsToCorrect",
    "ToJudge",
    "ValidationAsked",
    "ValidationShown",
    "Why",
    "WhyBody",
]
