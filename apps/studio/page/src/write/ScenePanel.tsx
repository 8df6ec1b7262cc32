// The mission's scene beside it: in 3-D, by seed, through its cameras. A fixture that is dragged moves in the scene's file.

import { useCallback, useEffect, useRef, useState } from "react";

import { call } from "../connection";
import type { CallError } from "../connection";
import { Button } from "../ui/Button";
import { Field } from "../ui/Field";
import { toast, toastError } from "../ui/Toast";
import { counted } from "../ui/words";
import { Stage } from "./stage";
import type { SceneContent, Shape } from "./stage";

interface Seen {
  colour: string;
  depth: string;
  near: number;
  far: number;
}

export function ScenePanel({ path, scene }: { path: string; scene: string }) {
  const host = useRef<HTMLDivElement>(null);
  const stage = useRef<Stage | null>(null);
  const [seed, setSeed] = useState(0);
  const [content, setContent] = useState<SceneContent | null>(null);
  const [error, setError] = useState("");
  const [chosen, setChosen] = useState("");
  const [seen, setSeen] = useState<{ camera: string; seed: number; picture: Seen | null } | null>(null);
  // The scene's own file: its text, and what it was when it was read.
  const [file, setFile] = useState<{ text: string; saved: string; version: string } | null>(null);
  const text = file && file.text !== file.saved ? file.text : null;
  const now = useRef({ file, content });
  now.current = { file, content };
  const moves = useRef({ last: Promise.resolve(), open: 0 });

  // The page shows the new place at once; the text follows, one move after the other, and what was asked before is old.
  const move = useCallback((name: string, x: number, y: number) => {
    const before = now.current.content;
    if (!before || !now.current.file) return;
    const content = moved(before, name, x, y);
    now.current.content = content;
    setContent(content);
    stage.current?.show(content);
    moves.current.open++;
    moves.current.last = moves.current.last.then(async () => {
      const file = now.current.file;
      if (!file) return;
      const { text } = await call<{ text: string }>("scene.move", { text: file.text, fixture: name, x, y });
      now.current.file = { ...now.current.file!, text };
      setFile(now.current.file);
    }).catch((failed: CallError) => {
      toastError(failed);
      now.current.content = before;
      setContent(before);
      stage.current?.show(before);
    }).finally(() => { moves.current.open--; });
  }, []);
  useEffect(() => {
    let made: Stage;
    try {
      made = new Stage(host.current!, () => now.current.file !== null, setChosen, move);
    } catch {
      return setError("This browser cannot draw in 3-D (WebGL).");
    }
    stage.current = made;
    return () => {
      made.close();
      stage.current = null;
    };
  }, [move]);

  useEffect(() => {
    let wanted = true;
    call<Shape>("scene.robot", { mission: path, scene }).then((robot) => wanted && stage.current?.showRobot(robot), () => undefined);
    return () => { wanted = false; };
  }, [path, scene]);
  useEffect(() => {
    let wanted = true;
    call<SceneContent>("scene.show", { mission: path, scene, seed, text }).then((found) => {
      if (!wanted || moves.current.open) return;
      setContent(found);
      setError("");
      stage.current?.show(found);
    }, (failed: CallError) => wanted && setError(failed.message));
    return () => { wanted = false; };
  }, [path, scene, seed, text]);
  const own = content?.file ?? "";
  useEffect(() => {
    if (!own) return setFile(null);
    call<{ text: string; version: string }>("files.read", { path: own }).then((found) => setFile({ text: found.text, saved: found.text, version: found.version }), toastError);
  }, [own]);

  // What was moved last is saved, too, though its text may still be on its way.
  const save = async () => {
    await moves.current.last;
    const { file } = now.current;
    if (!file) return;
    call<{ version: string }>("files.write", { path: own, text: file.text, version: file.version }).then((written) => {
      setFile((since) => since && { ...since, saved: file.text, version: written.version });
      toast(`${own} saved`, "success");
    }, toastError);
  };
  const look = (camera: string) => {
    setSeen({ camera, seed, picture: null });
    call<Seen>("scene.camera", { mission: path, scene, seed, camera, text }).then((picture) => setSeen({ camera, seed, picture }), (failed: CallError) => {
      setSeen(null);
      toastError(failed);
    });
  };
  const choose = (name: string) => {
    setChosen(name);
    stage.current?.choose(name);
  };
  const fixed = [...new Map((content?.bodies ?? []).filter((body) => body.kind !== "item").map((body) => [body.name, body])).values()];
  const body = fixed.find((each) => each.name === chosen);
  const items = content?.bodies.filter((each) => each.kind === "item").length ?? 0;
  return (
    <div className="scene">
      <div className="seed" role="group" aria-label="Seed">
        <Button onClick={() => setSeed(Math.max(0, seed - 1))} disabled={seed === 0} title="The seed before">−</Button>
        <label>Seed <input type="number" min={0} value={seed} onChange={(event) => setSeed(Math.max(0, Math.floor(Number(event.target.value) || 0)))} /></label>
        <Button onClick={() => setSeed(seed + 1)} title="The next seed">+</Button>
        <span className="muted">{scene}, {counted(items, "item")}</span>
      </div>
      <div className="scene-view" ref={host} role="img" aria-label={`Scene ${scene} with seed ${seed}: ${counted(items, "item")}, ${fixed.map((each) => each.name).join(", ")}`} />
      {error && <p className="problem" role="alert">{error}</p>}
      <Field label="Fixture or bin" hint={file ? "Drag the fixture in the picture, or write its place." : "A shipped scene is not changed: copy it beside the mission first."}>
        {(attributes) => <select {...attributes} value={chosen} onChange={(event) => choose(event.target.value)}><option value="">none</option>{fixed.map((each) => <option key={each.name}>{each.name}</option>)}</select>}
      </Field>
      {body && file && (
        <div className="seed">
          {(["x", "y"] as const).map((axis, number) => (
            <Coordinate key={`${body.name} ${axis}`} axis={axis} value={body.position[number]!} onEnter={(value) => move(body.name, number ? body.position[0] : value, number ? value : body.position[1])} />
          ))}
        </div>
      )}
      {file && <div className="buttons"><Button primary onClick={save} disabled={text === null}>Save {own}</Button><Button onClick={() => setFile({ ...file, text: file.saved })} disabled={text === null}>Take back</Button></div>}
      <div className="buttons">{content?.views.map((camera) => <Button key={camera} onClick={() => look(camera)} disabled={seen !== null && seen.picture === null}>What {camera} sees</Button>)}</div>
      {seen && (seen.picture ? (
        <figure className="views">
          <img src={seen.picture.colour} alt={`Colour image of ${seen.camera} with seed ${seen.seed}`} />
          <img src={seen.picture.depth} alt={`Depth image of ${seen.camera} with seed ${seen.seed}`} />
          <figcaption className="muted">{seen.camera}, seed {seen.seed}; depth {seen.picture.near.toFixed(2)} to {seen.picture.far.toFixed(2)} m, near is bright</figcaption>
        </figure>
      ) : <p className="loading"><span className="spinner" /> The scene settles in physics…</p>)}
    </div>
  );
}

function moved(content: SceneContent, name: string, x: number, y: number): SceneContent {
  const place = content.bodies.filter((body) => body.name === name).at(-1)?.position;
  if (!place) return content;
  const by = [x - place[0], y - place[1]] as const;
  return { ...content, bodies: content.bodies.map((body) => (body.name === name ? { ...body, position: [body.position[0] + by[0], body.position[1] + by[1], body.position[2]] } : body)) };
}

// One number of a place. What is being typed stays, whatever answers arrive meanwhile.
function Coordinate({ axis, value, onEnter }: { axis: string; value: number; onEnter: (value: number) => void }) {
  const [typed, setTyped] = useState<string | null>(null);
  const enter = () => {
    const wanted = Number(typed);
    if (typed && Math.abs(wanted - value) > 1e-5) onEnter(wanted);
    setTyped(null);
  };
  return (
    <label>{axis}, m <input type="number" step={0.01} value={typed ?? Number(value.toFixed(4))} onChange={(event) => setTyped(event.target.value)} onBlur={enter}
      onKeyDown={(event) => { if (event.key === "Enter") event.currentTarget.blur(); }} /></label>
  );
}
