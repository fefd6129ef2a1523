//! The process that gives one reader its inputs. It ends with the first input that comes to a bad end.

use super::mutations::Mutator;
use super::targets::{self, BESIDE, named, within_memory};
use super::{JOB, Job, seeds};
use std::env;
use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::thread;
use std::time::{Duration, Instant};

/// What stands before the number of inputs.
pub(super) const INPUTS: &str = "inputs: ";

/// The target that is the whole program: `info`, and the smallest picture.
pub(super) const PROGRAM: &str = "program";

/// Targets that do what none should, each with a part of what is said then.
pub(super) const FAULTS: [(&str, &str); 4] = [
    ("panics", "a deliberate panic"),
    ("aborts", "signal"),
    ("hangs", "took too long"),
    ("grows", "bytes were taken"),
];

type Run = Box<dyn Fn(&Path, &[u8])>;

#[test]
#[ignore = "other tests start it as a process"]
fn works() {
    let Ok(job) = env::var(JOB) else { return };
    let job: Job = serde_json::from_str(&job).expect("a job");
    let end = Instant::now() + job.time;
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let (run, seeds, dictionary): (Run, _, _) = match targets::target(&job.target) {
        Some(target) => {
            let run = |folder: &Path, input: &[u8]| target.run(folder, input);
            (Box::new(run), seeds::seeds(target.name, &scenes), target.dictionary)
        }
        None if job.target == PROGRAM => {
            let draw = targets::target("draw").expect("it is there");
            (Box::new(program), seeds::seeds("draw", &scenes), draw.dictionary)
        }
        None => (fault(&job.target), vec![b"fault".into()], "\"fault\""),
    };
    let inputs = watch(job.patience);
    let mut mutator = Mutator::new(seeds.clone(), dictionary, job.seed);
    let mut first = seeds.into_iter();
    while first.len() > 0 || Instant::now() < end {
        let input = first.next().unwrap_or_else(|| mutator.file());
        fs::write(job.folder.join("input"), &input).expect("the folder can be written");
        inputs.fetch_add(1, Relaxed);
        run(&job.folder, &input);
    }
    println!("\n{INPUTS}{}", inputs.load(Relaxed));
}

/// Ends the process when an input takes longer than `patience` of the processor's time: on a busy machine the clock
/// on the wall says nothing. Returns where the inputs are counted.
fn watch(patience: Duration) -> Arc<AtomicU64> {
    let inputs = Arc::new(AtomicU64::new(0));
    let watched = inputs.clone();
    thread::spawn(move || {
        let mut seen = (0, processor_time(), Instant::now());
        loop {
            thread::sleep(patience / 20);
            let (number, now) = (watched.load(Relaxed), processor_time());
            if number != seen.0 {
                seen = (number, now, Instant::now());
            }
            // Who waits for ever takes no time of the processor.
            let is_stuck = seen.2.elapsed() > 60 * patience;
            if now.saturating_sub(seen.1) > patience || is_stuck {
                eprintln!("the input took too long: over {patience:?}");
                std::process::exit(3);
            }
        }
    });
    inputs
}

/// The time that this process has had of the processor; zero except on Linux.
fn processor_time() -> Duration {
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = stat.rsplit(") ").next().unwrap_or_default();
    // The 14th and 15th field, in hundredths of a second: in user mode, and in the kernel.
    let ticks = after_name.split(' ').skip(11).take(2).filter_map(|word| word.parse::<u64>().ok());
    Duration::from_millis(10 * ticks.sum::<u64>())
}

/// Runs the program on a model, once to count what is in it and once to draw it.
fn program(folder: &Path, input: &[u8]) {
    let Some((name, model)) = named(input) else { return };
    for (name, bytes) in BESIDE.into_iter().chain([(&*name, model)]) {
        fs::write(folder.join(name), bytes).expect("the folder can be written");
    }
    let picture = folder.join("a.png");
    let _ = fs::remove_file(&picture);
    let draw = ["--size", "3x2", "--spp", "1", "--levels", "0", "--samples", "2", "-o", "a.png"];
    for arguments in [&["info", &name][..], &[&["render", &name][..], &draw].concat()] {
        let output = limited().current_dir(folder).args(arguments).output().expect("it runs");
        let said = String::from_utf8([output.stdout, output.stderr].concat()).expect("UTF-8");
        let code = output.status.code();
        assert!(matches!(code, Some(0 | 2)), "{arguments:?}: {}: {said}", output.status);
        for aborted in ["overflowed its stack", "fatal runtime error", "memory allocation of"] {
            assert!(!said.contains(aborted), "{arguments:?}: {said}");
        }
        assert!(said.chars().all(|c| c == '\n' || !c.is_control()), "{said:?}");
        assert!(said.len() < 1 << 16, "{} bytes: {said:.2000}", said.len());
        let is_drawn = arguments[0] == "render" && code == Some(0);
        assert_eq!(picture.exists(), is_drawn, "{arguments:?}: {said}");
    }
}

/// The program with bounds on memory and time, where a shell can set them.
fn limited() -> Command {
    let program = assert_cmd::cargo::cargo_bin("isolux");
    if cfg!(not(target_os = "linux")) {
        return Command::new(program);
    }
    let mut command = Command::new("sh");
    command.args(["-c", "ulimit -v 4000000; ulimit -t 10; exec \"$0\" \"$@\""]).arg(program);
    command
}

fn fault(name: &str) -> Run {
    match name {
        "panics" => Box::new(|_, _| panic!("a deliberate panic")),
        "aborts" => Box::new(|_, _| std::process::abort()),
        "hangs" => Box::new(|_, _| {
            loop {
                std::hint::spin_loop();
            }
        }),
        "grows" => Box::new(|_, input| {
            within_memory(input.len(), || drop(std::hint::black_box(vec![1u8; 13 << 26])));
        }),
        _ => panic!("no target is called {name}"),
    }
}
