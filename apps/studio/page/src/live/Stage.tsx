// The 3-D view of a run that goes on: belief solid, truth in outlines.

import { memo, useEffect, useRef, useState } from "react";

import { call } from "../connection";
import { Button } from "../ui/Button";
import type { LiveState } from "./state";
import { LiveStage } from "./stage3d";

export const Stage = memo(function Stage({ id, state }: { id: string; state: LiveState }) {
  const host = useRef<HTMLDivElement>(null);
  const tools = useRef<HTMLSpanElement>(null);
  const stage = useRef<LiveStage | null>(null);
  const [problem, setProblem] = useState("");
  const [truth, setTruth] = useState(true);
  const shown = useRef(state);
  shown.current = state;
  useEffect(() => {
    let wanted = true;
    let made: LiveStage | null = null;
    call<string>("live.stage", { id })
      .then((packed) => (wanted ? LiveStage.made(packed, host.current!, tools.current!) : null))
      .then((found) => {
        if (!found) return;
        if (!wanted) return found.close();
        made = stage.current = found;
        found.show(shown.current);
      })
      .catch((error: Error) => wanted && setProblem(error.message));
    return () => {
      wanted = false;
      made?.close();
      stage.current = null;
    };
  }, [id]);
  useEffect(() => stage.current?.show(state), [state.frames, state.belief, state.truth, state.looks]);
  useEffect(() => stage.current?.showTruth(truth), [truth]);
  const held = state.belief.find((body) => body.held);
  return (
    <>
      <div className="live-view" ref={host}>
        {problem && <p className="muted live-none">{problem}</p>}
        {held && <p className="live-held">holds {held.id}</p>}
      </div>
      <div className="live-tools">
        <span ref={tools} />
        <Button pressed={truth} onClick={() => setTruth(!truth)} title="True poses of the bodies, unknown to the robot">Truth</Button>
        <span className="muted wide-only">{state.belief.length} bodies in the belief, {state.truth.length} in truth</span>
      </div>
    </>
  );
});
