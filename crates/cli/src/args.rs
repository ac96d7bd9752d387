//! The command line: one source for help and completions.

use clap::{Args, CommandFactory as _, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Where is a swallowed capsule endoscope, and what must we build to know it to a millimetre?
#[derive(Debug, Parser)]
#[command(
    name = "lumenav",
    version,
    about,
    long_about = None,
    propagate_version = true,
    after_help = "Exit codes:
  0    done (also when nobody reads the output any more: lumenav ... | head)
  1    something failed
  2    the command line is not right
  3    something is wrong in a scenario, model or data file; file, line and key are named
  4    done, and something is not as the scenario expects ([expect])
  130  stopped with Ctrl-C; what is finished is kept

Examples:
  lumenav run scenarios/colon-magnetic.toml
  lumenav explain out/colon-magnetic-1
  lumenav view out/colon-magnetic-1"
)]
pub struct Arguments {
    /// Less output: no progress, no table.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// More output, on stderr: which files are read, how long stages take.
    #[arg(short, long, global = true)]
    verbose: bool,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// How much a command says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verbosity {
    /// Errors only.
    Quiet,
    /// Progress on stderr, results on stdout.
    Normal,
    /// As normal, and what is read and done on stderr.
    Verbose,
}

impl Arguments {
    /// How much to say.
    pub fn verbosity(&self) -> Verbosity {
        match (self.quiet, self.verbose) {
            (true, _) => Verbosity::Quiet,
            (false, true) => Verbosity::Verbose,
            (false, false) => Verbosity::Normal,
        }
    }
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Simulate a scenario: sense, estimate, fuse, evaluate, record.
    #[command(after_help = "Examples:
  lumenav run scenarios/colon-magnetic.toml
  lumenav run scenarios/helix-magnetic.toml --seed 7 --set sensor.plane.schedule.rate_hz=50
  lumenav run scenarios/helix-magnetic.toml --trials 20")]
    Run(RunOptions),
    /// Run recorded measurements through the same front ends and filters.
    #[command(after_help = "Example:
  LUMENAV_DATA=../shared/data lumenav replay scenarios/replay/magnet-patch.toml")]
    Replay(ReplayOptions),
    /// Run a published table or figure again: published, ours, a verdict per row.
    #[command(after_help = "Examples:
  lumenav reproduce --list
  lumenav reproduce than2015/rates
  lumenav reproduce than2015/few-lines --seeds 4,5,6 --out out/other-seeds
  lumenav reproduce than2015/few-lines --quick --json | jq '.rows[].verdict'")]
    Reproduce(ReproduceOptions),
    /// Say why a track lost the capsule: refusals with reasons, weakest direction, events, counters.
    #[command(after_help = "Example:
  lumenav explain out/colon-magnetic-1 --track magnetic-eskf --at 312s
  lumenav explain out/colon-magnetic-1 --json | jq .tracks")]
    Explain(ExplainOptions),
    /// List, show or check scenarios.
    #[command(
        subcommand,
        after_help = "Examples:
  lumenav scenarios list
  lumenav scenarios show scenarios/colon-magnetic.toml --resolved
  lumenav scenarios check mine.toml"
    )]
    Scenarios(ScenariosCommand),
    /// List, show or check models.
    #[command(
        subcommand,
        after_help = "Examples:
  lumenav models list
  lumenav models show sensor-arrays/belt-16
  lumenav models check"
    )]
    Models(ModelsCommand),
    /// List the modalities that this program knows.
    Plugins(PluginsOptions),
    /// Make a new scenario that works from the first minute.
    #[command(
        subcommand,
        after_help = "Example:
  lumenav new scenario mine.toml --from colon-magnetic"
    )]
    New(NewCommand),
    /// Judge the layout of a sensor before it is built, find a better one, set several side by side.
    #[command(
        subcommand,
        after_help = "Examples:
  lumenav layout evaluate scenarios/torso-belt-study.toml
  lumenav layout optimize scenarios/torso-belt-study.toml --out out/belt
  lumenav layout compare scenarios/torso-belt-study.toml"
    )]
    Layout(LayoutCommand),
    /// Write truth and tracks of a run as TUM, CSV, Parquet, KITTI or MCAP.
    #[command(after_help = "Example:
  lumenav export out/helix-magnetic-1 --format kitti --out exported")]
    Export(ExportOptions),
    /// Say what dose the markers of a run's capsule leave along the wall of its tract.
    #[command(after_help = "Examples:
  lumenav dose out/colon-pet-1
  lumenav dose out/colon-pet-1 --out out/dose")]
    Dose(DoseOptions),
    /// Open a recording in the Rerun viewer.
    View(ViewOptions),
    /// Print shell completions.
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
}

/// Options of `run`.
#[derive(Clone, Debug, Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the command line")]
pub struct RunOptions {
    /// The scenario file.
    pub scenario: PathBuf,
    /// Folder to write; default out/<scenario>-<seed>, with trials out/<scenario>-<seed>.trials.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Seed; default the scenario's.
    #[arg(long)]
    pub seed: Option<u64>,
    /// Independent trials, in parallel; writes trials/NNN/ and one table with 95 % intervals. Stopped trials go on with the
    /// same command: those that are finished are used again.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    pub trials: u64,
    /// Threads for --trials; default all.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Replace a value of the scenario: table.key=value; entries of arrays by name or number.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Print the metrics as JSON instead of a table.
    #[arg(long)]
    pub json: bool,
    /// Read and check everything, run nothing.
    #[arg(long)]
    pub dry_run: bool,
    /// Also send the recording to a running viewer, host:port.
    #[arg(long, value_name = "ADDRESS")]
    pub connect: Option<String>,
    /// Write what the sensors measured, for `lumenav replay`.
    #[arg(long)]
    pub save_readings: bool,
    /// Keep the world's state in this folder as it goes, and let a scenario with `observe_from_s` start from the latest state of its world that
    /// lies before, instead of from zero: the same bytes, sooner.
    #[arg(long, value_name = "FOLDER")]
    pub checkpoints: Option<PathBuf>,
    /// Simulated seconds between two states.
    #[arg(long, value_name = "SECONDS", default_value_t = 600, requires = "checkpoints", value_parser = clap::value_parser!(u32).range(1..))]
    pub checkpoint_every: u32,
    /// How much the recording keeps.
    #[arg(long, value_enum, default_value_t = Record::Bounded)]
    pub record: Record,
    /// Replace an existing run folder (an empty folder or one that lumenav wrote, nothing else).
    #[arg(long)]
    pub force: bool,
    /// Folder of models; default: `models` beside or above the scenario.
    #[arg(long)]
    pub models: Option<PathBuf>,
}

/// How much a recording keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Record {
    /// Nothing.
    None,
    /// Thinned to the size budget.
    Bounded,
    /// Every row.
    Full,
}

/// Options of `replay`.
#[derive(Clone, Debug, Args)]
pub struct ReplayOptions {
    /// The replay file.
    pub replay: PathBuf,
    /// Folder to write; default out/<name>-<seed>.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Replace a value of the file.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Print the metrics as JSON instead of a table.
    #[arg(long)]
    pub json: bool,
    /// How much the recording keeps.
    #[arg(long, value_enum, default_value_t = Record::Bounded)]
    pub record: Record,
    /// Replace an existing run folder (an empty folder or one that lumenav wrote, nothing else).
    #[arg(long)]
    pub force: bool,
    /// Folder of models; default: `models` beside or above the file.
    #[arg(long)]
    pub models: Option<PathBuf>,
}

/// Options of `reproduce`.
#[derive(Clone, Debug, Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the command line")]
pub struct ReproduceOptions {
    /// What to run, as --list names it.
    #[arg(required_unless_present = "list", value_parser = reproduction_ids())]
    pub id: Option<String>,
    /// List what there is.
    #[arg(long, conflicts_with_all = ["id", "out", "seed", "seeds", "quick", "force", "threads"])]
    pub list: bool,
    /// Print the table as JSON.
    #[arg(long)]
    pub json: bool,
    /// One seed instead of the usual ones.
    #[arg(long, conflicts_with = "seeds")]
    pub seed: Option<u64>,
    /// Seeds instead of the usual ones, for example 4,5,6.
    #[arg(long, value_delimiter = ',')]
    pub seeds: Vec<u64>,
    /// Folder to write <id>.json and <id>.svg into.
    #[arg(long, default_value = "out/reproduce")]
    pub out: PathBuf,
    /// A fraction of the windows: seconds, to see that it works.
    #[arg(long)]
    pub quick: bool,
    /// Threads; default all. The result is the same for any number.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Replace an earlier table of the same id.
    #[arg(long)]
    pub force: bool,
    /// Folder of models; default: `models` in or above the working folder.
    #[arg(long)]
    pub models: Option<PathBuf>,
}

fn body_sizes() -> clap::builder::PossibleValuesParser {
    clap::builder::PossibleValuesParser::new(
        lumenav::anatomy::generator::BodySize::ALL.map(lumenav::anatomy::generator::BodySize::as_str),
    )
}

fn reproduction_ids() -> clap::builder::PossibleValuesParser {
    clap::builder::PossibleValuesParser::new(lumenav::reproduce::all().into_iter().map(|r| r.id))
}

/// Options of `explain`.
#[derive(Clone, Debug, Args)]
pub struct ExplainOptions {
    /// A run's folder.
    pub run: PathBuf,
    /// Only this track.
    #[arg(long)]
    pub track: Option<String>,
    /// Only the ten seconds around this time, for example 312s.
    #[arg(long, value_parser = seconds)]
    pub at: Option<f64>,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

fn seconds(text: &str) -> Result<f64, String> {
    let number = text.strip_suffix('s').unwrap_or(text);
    match number.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(format!("`{text}` is no time; give seconds, for example 312s")),
    }
}

/// What to do with scenarios.
#[derive(Debug, Subcommand)]
pub enum ScenariosCommand {
    /// List the scenarios in a folder.
    List {
        /// The folder.
        #[arg(default_value = "scenarios")]
        folder: PathBuf,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Show a scenario; with --resolved every key with its value, default or set, and unit.
    Show {
        /// The scenario file.
        scenario: PathBuf,
        /// Every key with its value, default or set, and unit.
        #[arg(long)]
        resolved: bool,
        /// Replace a value of the scenario.
        #[arg(long = "set", value_name = "KEY=VALUE")]
        set: Vec<String>,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Check scenarios: every table and every model they name.
    Check {
        /// The scenario files.
        #[arg(required = true)]
        scenarios: Vec<PathBuf>,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
}

/// What to do with models.
#[derive(Debug, Subcommand)]
pub enum ModelsCommand {
    /// List the models there are.
    List {
        /// The models folder.
        #[arg(long, default_value = "models")]
        models: PathBuf,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Show a model: kind/name, or its name alone.
    Show {
        /// For example sensor-arrays/belt-16.
        model: String,
        /// The models folder.
        #[arg(long, default_value = "models")]
        models: PathBuf,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Check all models of the folder.
    Check {
        /// The models folder.
        #[arg(long, default_value = "models")]
        models: PathBuf,
        /// Print JSON.
        #[arg(long)]
        json: bool,
    },
    /// Make a model from a seed.
    Generate {
        /// What.
        #[command(subcommand)]
        what: GenerateCommand,
    },
    /// Make a tract of a person's own gut: a surface (STL, OBJ, PLY), watertight or nearly so.
    Import(ImportTract),
    /// Figures of tracts beside those measured in people.
    Statistics {
        /// The tract files.
        #[arg(required = true)]
        tracts: Vec<PathBuf>,
    },
}

/// What is made from a seed.
#[derive(Debug, Subcommand)]
pub enum GenerateCommand {
    /// A whole gut, mouth to rectum, within what is measured in people.
    Tract(GenerateTract),
}

/// A tract from a seed.
#[derive(Debug, Args)]
pub struct GenerateTract {
    /// The torso.
    #[arg(long, default_value = "average-man", value_parser = body_sizes())]
    pub size: String,
    /// The seed; the same seed gives the same file.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Factor on the length of jejunum and ileum (a cadaver's are twice as long).
    #[arg(long, default_value_t = 1.0)]
    pub length_scale: f64,
    /// Factor on all radii.
    #[arg(long, default_value_t = 1.0)]
    pub radius_scale: f64,
    /// The file to write.
    #[arg(long)]
    pub out: PathBuf,
    /// Replace a file that is there.
    #[arg(long)]
    pub force: bool,
}

/// A tract from a surface or a label volume.
#[derive(Debug, Args)]
pub struct ImportTract {
    /// The surface (.stl, .obj, .ply) or label volume (.nii, .nii.gz, .mha, .mhd).
    pub file: PathBuf,
    /// The tract file to write.
    #[arg(long)]
    pub out: PathBuf,
    /// Metres per unit of the surface's file: 0.001 where it is in millimetres. Label volumes state millimetres; theirs are multiplied by it.
    #[arg(long, default_value_t = 1.0)]
    pub factor: f64,
    /// Label of the lumen in a label volume, where it has several; may be repeated.
    #[arg(long, allow_hyphen_values = true)]
    pub label: Vec<i64>,
    /// Which way its axes point.
    #[arg(long, value_parser = ["ras", "lps"])]
    pub axes: Option<String>,
    /// What it shows, where length and radius do not tell.
    #[arg(long, value_parser = ["small-bowel", "colon"])]
    pub organ: Option<String>,
    /// The tract's name; the file's otherwise.
    #[arg(long)]
    pub name: Option<String>,
    /// Where a segment begins, SEGMENT=x,y,z in mm of the surface's frame; may be repeated.
    #[arg(long, allow_hyphen_values = true)]
    pub start: Vec<String>,
    /// Both ends and places between them, x,y,z in mm of the surface's frame, from mouth to anus; or the oral end alone.
    #[arg(long, num_args = 1.., allow_hyphen_values = true)]
    pub waypoints: Vec<String>,
    /// Move the tract so that the middle of its box is at the origin, around which the shipped arrays and scanners stand.
    #[arg(long)]
    pub centre: bool,
    /// Replace a file that is there.
    #[arg(long)]
    pub force: bool,
}

/// Options of `plugins`.
#[derive(Clone, Debug, Args)]
pub struct PluginsOptions {
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// What to make.
#[derive(Debug, Subcommand)]
pub enum NewCommand {
    /// A scenario, copied from one that works.
    Scenario {
        /// The file to write.
        file: PathBuf,
        /// What to start from: the name of a shipped scenario (see `lumenav scenarios list`), or a file.
        #[arg(long, default_value = "helix-magnetic", value_name = "NAME")]
        from: String,
        /// Folder of models; default: `models` beside or above the file.
        #[arg(long)]
        models: Option<PathBuf>,
    },
}

/// What to do with a layout.
#[derive(Debug, Subcommand)]
pub enum LayoutCommand {
    /// Map the bound over the workspace: criteria, share below the wanted error, what is left when sensors die.
    Evaluate(LayoutOptions),
    /// Find a layout: choose from candidates, or move the installed sensors; writes a sensor array that `run` takes as it is.
    Optimize(LayoutOptions),
    /// Set the scenario's layout and its alternatives side by side: cost against accuracy.
    Compare(LayoutOptions),
}

/// Options of `layout`.
#[derive(Clone, Debug, Args)]
pub struct LayoutOptions {
    /// A scenario with a `[layout]`.
    pub scenario: PathBuf,
    /// Folder to write; default out/layout/<scenario>.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Replace a value of the scenario: table.key=value; entries of arrays by name or number.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Print the result as JSON.
    #[arg(long)]
    pub json: bool,
    /// Threads; default all. The result is the same for any number.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Replace existing files.
    #[arg(long)]
    pub force: bool,
    /// Folder of models; default: `models` beside or above the scenario.
    #[arg(long)]
    pub models: Option<PathBuf>,
}

/// Options of `export`.
#[derive(Clone, Debug, Args)]
pub struct ExportOptions {
    /// A run's folder.
    pub run: PathBuf,
    /// The format.
    #[arg(long, value_enum, default_value_t = ExportFormat::Tum)]
    pub format: ExportFormat,
    /// Folder to write, outside the run's folder.
    #[arg(long, default_value = "export")]
    pub out: PathBuf,
    /// Only this track.
    #[arg(long)]
    pub track: Option<String>,
    /// Replace existing files.
    #[arg(long)]
    pub force: bool,
    /// Print what was written as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Options of `dose`.
#[derive(Clone, Debug, Args)]
pub struct DoseOptions {
    /// The folder of a run through a tract.
    pub run: PathBuf,
    /// Dose rate constant of the markers' isotope, uSv m2/(h MBq); default 0.362 for Na-22 (than2015, section 3.6).
    #[arg(long)]
    pub dose_rate_constant: Option<f64>,
    /// Folder for dose.csv and dose.svg; default: only the table is printed.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// The models folder; default the nearest `models`.
    #[arg(long)]
    pub models: Option<PathBuf>,
    /// Replace existing files.
    #[arg(long)]
    pub force: bool,
    /// Print the table as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Formats of `export`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ExportFormat {
    /// t x y z qx qy qz qw
    Tum,
    /// A header line, one row per update, with covariance and errors.
    Csv,
    /// tracks.parquet as it is: all tracks in one file.
    Parquet,
    /// Twelve numbers of the 3 x 4 pose matrix.
    Kitti,
    /// One file for Foxglove and ROS tools: channels /truth and /tracks/<track>.
    Mcap,
}

/// Options of `view`.
#[derive(Clone, Debug, Args)]
pub struct ViewOptions {
    /// A recording, or a run's folder.
    pub recording: PathBuf,
}

/// Prints completions for a shell.
///
/// # Errors
/// Where nobody reads them.
pub fn completions(shell: clap_complete::Shell) -> anyhow::Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Arguments::command(), "lumenav", &mut script);
    crate::output::print(format_args!("{}", String::from_utf8_lossy(&script)))
}
