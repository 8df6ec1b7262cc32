// The missions of the folder, and a way to the examples where there are none.

import { call, useCall } from "../connection";
import type { ListedFile } from "../records";
import { href } from "../routing";
import { Button } from "../ui/Button";
import { Empty } from "../ui/Empty";
import { toast, toastError } from "../ui/Toast";
import { counted } from "../ui/words";
import { useEffect, useState } from "react";

export function Missions() {
  useEffect(() => void call("mission.prepare").catch(() => undefined), []);
  const [again, setAgain] = useState(0);
  const missions = useCall<ListedFile[]>("files.list", { kind: "mission" }, again);
  const copy = () => void call<string[]>("folder.copy_examples").then((written) => {
    toast(`${counted(written.length, "file")} written`, "success");
    setAgain(again + 1);
  }, toastError);
  if (missions.error) return <Empty title="The folder cannot be read"><p>{missions.error.message}</p></Empty>;
  if (!missions.value) return <p className="loading">Looking for missions…</p>;
  if (!missions.value.length)
    return (
      <Empty title="No mission here yet">
        <p>Begin with an example, and change it.</p>
        <Button primary onClick={copy}>Copy the examples into this folder</Button>
      </Empty>
    );
  return (
    <div className="start">
      <h1>Missions</h1>
      <ul className="card">
        {missions.value.map((each) => <li key={each.path}><a href={href("write", each.path)}>{each.path}</a> <span className="muted">{each.name}</span></li>)}
      </ul>
    </div>
  );
}
