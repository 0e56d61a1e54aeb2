"""What is installed, over REST: kinds of job and control laws."""

from functools import cache

from fastapi import APIRouter

from pincette.api.job_kinds import job_kinds
from pincette.api.kinds import KindList, described
from pincette.api.plans import LawList
from pincette.config.laws import described_laws
from pincette_supervisor.rest.dependencies import OBSERVE
from pincette_supervisor.rest.strict_route import StrictRoute

router = APIRouter(route_class=StrictRoute)


@cache
def _installed_kinds() -> KindList:
    """Describe every installed kind; their schemas do not change while the program runs."""
    return KindList(kinds=[described(kind) for kind in job_kinds().values()])


@router.get("/kinds", tags=["jobs"], dependencies=[OBSERVE])
def kinds() -> KindList:
    """Every kind of job that is installed: its request, form, actions and figures."""
    return _installed_kinds()


@router.get("/laws", tags=["laws"], dependencies=[OBSERVE])
def laws() -> LawList:
    """The control laws that a job may choose, each with its gains."""
    return LawList(laws=described_laws())
