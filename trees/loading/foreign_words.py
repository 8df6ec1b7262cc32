"""Names of nodes in BehaviorTree.CPP, Nav2, py_trees and game engines, and what to write here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

FOREIGN_WORDS: Final[Mapping[str, str]] = {
    # BehaviorTree.CPP
    "LoopBool": "a loop over a list is 'ForEach: {in: …, out: \"{key}\", do: …}'",
    "LoopDouble": "a loop over a list is 'ForEach: {in: …, out: \"{key}\", do: …}'",
    "LoopInt": "a loop over a list is 'ForEach: {in: …, out: \"{key}\", do: …}'",
    "LoopString": "a loop over a list is 'ForEach: {in: …, out: \"{key}\", do: …}'",
    "ManualSelector": "there is no choosing by hand",
    "Precondition": "a condition stands at the node itself, as '_skipIf: …' or '_failureIf: …'",
    "ScriptCondition": "an expression is asked by 'Condition: {if: …}'",
    "SequenceStar": "this is of format 3; in format 4 it is <SequenceWithMemory>",
    "SubTree": "a tree is used by its name, as 'PutDown: {object: \"{item}\"}'",
    "SubTreePlus": "this is of format 3; in format 4 it is <SubTree>",
    "Switch2": "Switch, with any number of cases",
    "Switch3": "Switch, with any number of cases",
    "Switch4": "Switch, with any number of cases",
    "Switch5": "Switch, with any number of cases",
    "Switch6": "Switch, with any number of cases",
    "UnsetBlackboard": "a key cannot be taken away; write null with SetBlackboard",
    # Nav2
    "BackUp": "Jog moves the tool, SafeRetreat gets the arm clear",
    "DistanceController": "RateController bounds how often a child begins",
    "DriveOnHeading": "Jog moves the tool, GoTo the arm",
    "GoalUpdated": "WasEntryUpdated",
    "SingleTrigger": "RunOnce, with 'then_skip: false'",
    "SpeedController": "RateController bounds how often a child begins",
    "Wait": "Sleep",
    "GoalUpdatedController": "SkipUnlessUpdated",
    "IsGoalUpdated": "WasEntryUpdated",
    "NonblockingSequence": "PipelineSequence comes near; it goes on past a child that runs again",
    "PersistentSequence": "SequenceWithMemory",
    # py_trees
    "CheckBlackboardVariableExists": "ask for the key in a Condition, as 'Condition: {if: key != null}'",
    "CheckBlackboardVariableValue": "ask for the value in a Condition, as 'Condition: {if: key == 3}'",
    "EternalGuard": "a condition stands at the node itself, as '_while: …'",
    "Failure": "AlwaysFailure",
    "FailureIsRunning": "RetryUntilSuccessful, with 'num_attempts: -1'",
    "FailureIsSuccess": "ForceSuccess",
    "OneShot": "RunOnce",
    "Retry": "RetryUntilSuccessful, or a Recover where the cause decides",
    "RunningIsFailure": "a Timeout bounds how long a child may be RUNNING",
    "RunningIsSuccess": "a Timeout bounds how long a child may be RUNNING",
    "SetBlackboardVariable": "SetBlackboard",
    "Assign": "Script",
    "StatusToBlackboard": "an assignment stands at the node itself, as '_onSuccess: …' and '_onFailure: …'",
    "Success": "AlwaysSuccess",
    "SuccessIsFailure": "ForceFailure",
    "SuccessIsRunning": "KeepRunningUntilFailure",
    "TickCounter": "Sleep",
    "UnsetBlackboardVariable": "a key cannot be taken away; write null with SetBlackboard",
    "WaitForBlackboardVariable": "wait by 'RetryUntilSuccessful: {num_attempts: -1, do: {Condition: …}}'",
    # Words of every day, and of game engines
    "Catch": "Recover",
    "Cooldown": "a Delay in it waits; RateController bounds how often a child begins",
    "Drop": "Place puts down, OpenGripper lets go",
    "Failer": "AlwaysFailure, or ForceFailure around a child",
    "For": "ForEach over a list, Repeat for a number of times",
    "If": "IfThenElse, or '_skipIf: …' at the node itself",
    "Limiter": "Repeat and RetryUntilSuccessful count; Budget bounds recovery",
    "Look": "Observe",
    "Loop": "Repeat for a number of times, ForEach over a list",
    "Move": "GoTo for a named pose, Jog for a distance",
    "MoveTo": "GoTo for a named pose, Jog for a distance",
    "Negate": "Inverter",
    "Not": "Inverter",
    "Pick": "Grasp",
    "PickUp": "Grasp",
    "Priority": "Fallback",
    "PrioritySelector": "Fallback",
    "Release": "OpenGripper lets go, Place puts down",
    "Repeater": "Repeat",
    "Selector": "Fallback",
    "SelectorWithMemory": "Fallback",
    "Succeeder": "AlwaysSuccess, or ForceSuccess around a child",
    "Try": "Fallback tries one after the other, Recover handles causes",
    "UntilFail": "KeepRunningUntilFailure",
    "UntilFailure": "KeepRunningUntilFailure",
    "UntilSuccess": "RetryUntilSuccessful",
    "While": "'Repeat: {while: …, do: …}' for a loop, WhileDoElse for a choice at each tick",
}
"""Hint for each name that is no node here; a single word is the node that is meant."""
_FOLDED: Final = {word.casefold(): hint for word, hint in FOREIGN_WORDS.items()}


def foreign_word(name: str) -> str:
    """Return what to write for a node of another library or engine; "" for an unknown word.

    >>> foreign_word("selector"), foreign_word("Graps")
    ("did you mean 'Fallback'?", '')
    """
    hint = _FOLDED.get(name.replace("_", "").casefold(), "")
    return f"did you mean {hint!r}?" if hint.isidentifier() else hint
