"""The bodies of requests and answers, as OpenAPI describes them: every field with its unit and an example."""

from service.http.wire.bodies.asked import (
    AnswerBody,
    Export,
    ExportBody,
    NewCampaign,
    NewLoop,
    NewRun,
    RegressionAsked,
    Resume,
    ResumeBody,
    TakeLease,
    TakeLeaseOver,
    TargetsToCorrect,
    ToFit,
    WhyBody,
)
from service.http.wire.bodies.campaign import CampaignTable
from service.http.wire.bodies.cell import (
    Campaigns,
    CampaignShown,
    CellShown,
    DatasetMapped,
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
    Runs,
    RunShown,
)
from service.http.wire.bodies.selections import SelectionAsked
from service.http.wire.bodies.targets import CorrectedProgram, CorrectedTargets
from service.http.wire.bodies.told import Answered
from service.http.wire.bodies.validations import ValidationAsked

__all__ = [
    "AlignmentShown",
    "AnswerBody",
    "Answered",
    "CampaignShown",
    "CampaignTable",
    "Campaigns",
    "CellShown",
    "CorrectedProgram",
    "CorrectedTargets",
    "DatasetMapped",
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
    "PlacementsAsked",
    "PlacementsShown",
    "ProblemKept",
    "ProblemShown",
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
    "ToFit",
    "ValidationAsked",
    "ValidationShown",
    "WhyBody",
]
