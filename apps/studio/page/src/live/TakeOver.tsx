// A mission of the folder takes over in a run, or is refused with its faults.

import { useState } from "react";

import { call, useCall } from "../connection";
import type { FolderState } from "../start/Start";
import { Button } from "../ui/Button";
import { Dialog } from "../ui/Dialog";
import { Field } from "../ui/Field";
import { toast } from "../ui/Toast";

export function TakeOver({ id, onClose }: { id: string; onClose(): void }) {
  const { value: folder } = useCall<FolderState>("folder.state", {});
  const [chosen, setChosen] = useState("");
  const [refused, setRefused] = useState("");
  const missions = folder?.files.filter((file) => file.kind === "mission") ?? [];
  const mission = chosen || (missions[0]?.path ?? "");
  const take = async () => {
    setRefused("");
    try {
      const said = await call<string>("live.take", { id, mission });
      if (!said.startsWith("the edit is good")) return setRefused(said);
      toast(`${mission} takes over between two items`, "success");
      onClose();
    } catch (error) {
      setRefused((error as Error).message);
    }
  };
  return (
    <Dialog title="Take over a mission" onClose={onClose}>
      <p>The run goes on with this mission from the next item on. Belief, blackboard and counts stay; nodes with the same path and type go on as they are.</p>
      <Field label="Mission">
        {(attributes) => (
          <select {...attributes} value={mission} onChange={(event) => setChosen(event.target.value)}>
            {missions.map((file) => <option key={file.path} value={file.path}>{file.path}</option>)}
          </select>
        )}
      </Field>
      {refused && <pre role="alert" tabIndex={0}>{refused}</pre>}
      <p className="buttons"><Button primary disabled={!mission} onClick={() => void take()}>Take over</Button> <Button onClick={onClose}>Cancel</Button></p>
    </Dialog>
  );
}
