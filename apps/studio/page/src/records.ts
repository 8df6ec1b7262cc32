// Records of the server, made by docs/page_types.py from their declarations in Python.

// YAML file of picktree below the folder.
export interface ListedFile {
  path: string;
  kind: string;
  name: string;
}

// Text of a file with its version, which a later write names to notice changes of others.
export interface TextFile {
  path: string;
  text: string;
  version: string;
}

// Row of one run. None: the log has no result, or lacks the value.
export interface RunRow {
  folder: string;
  log: string;
  written: number;
  size: number;
  status: string;
  mission: string;
  scene: string;
  robot: string;
  backend: string;
  seed: number | null;
  sorted: number | null;
  total: number | null;
  misplaced: number | null;
  held: number | null;
  seconds: number | null;
  units_an_hour: number | null;
  first_pass: number | null;
  mtbf: number | null;
  mtbf_a: number | null;
  assists: number | null;
  lost: number | null;
  cause: string;
  causes: string[];
  message: string;
}

// Cell of the matrix: one variant with its cost.
export interface VariantForecast {
  label: string;
  mission: string;
  scene: string;
  robot: string;
  faults: string;
  settings: Record<string, string>;
  jobs: number;
  cpu_seconds: number | null;
  recorded: number;
}

// Matrix of a plan with its cost.
export interface BatchForecast {
  name: string;
  backend: string;
  keep: string;
  variants: VariantForecast[];
  workers: number;
}

// Input or output.
export interface PortEntry {
  key: string;
  direction: string;
  type: string;
  doc: string;
  required: boolean;
  default: string;
  unit: string;
  choices: string[];
  names: string;
  bounds: string;
  may_use: string;
}

// Slot for children.
export interface SlotEntry {
  key: string;
  form: string;
  doc: string;
  required: boolean;
}
