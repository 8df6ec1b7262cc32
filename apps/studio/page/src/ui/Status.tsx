// Status of a run: a sign, a word and a colour, so that it is told without any one of them.

const SIGNS: Record<string, [sign: string, kind: string]> = {
  success: ["✓", "success"],
  incomplete: ["◐", "failure"],
  failure: ["✗", "failure"],
  timeout: ["◔", "failure"],
  paused: ["‖", "open"],
  interrupted: ["■", "open"],
  stopped: ["⊘", "open"],
  running: ["▶", "running"],
  killed: ["†", "open"],
  crashed: ["†", "failure"],
  waiting: ["…", "open"],
  unknown: ["?", "open"],
  unreadable: ["?", "open"],
};

export function Status({ status }: { status: string }) {
  const [sign, kind] = SIGNS[status] ?? ["·", "open"];
  return <span className={`status ${kind}`}><span aria-hidden="true">{sign}</span> {status}</span>;
}
