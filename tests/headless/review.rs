//! Tests of the counts of confirmed frames and of frames to check, through the command line.

use serde_json::{Value, json};

use super::recording::Recording;
use crate::program::{done, refused};

fn info(project: &str, options: &[&str]) -> Value {
    let args = [&["info", project, "--json"], options].concat();
    serde_json::from_str(&done(&args)).unwrap()
}

/// Returns the reasons why each frame is to be checked.
fn reasons(info: &Value) -> Vec<Vec<&str>> {
    fn of_frame(frame: &Value) -> Vec<&str> {
        let check = frame["check"].as_array().unwrap();
        check
            .iter()
            .map(|one| one["reason"].as_str().unwrap())
            .collect()
    }
    let frames = info["frames"].as_array().unwrap();
    frames.iter().map(of_frame).collect()
}

#[test]
fn info_counts_confirmed_frames_and_says_which_to_check_and_why() {
    let recording = Recording::new();
    let project = recording.project();
    for label in ["thing", "other"] {
        done(&["label", &project, label]);
    }
    done(&[
        "prompt", &project, "--frame", "0", "--label", "thing", "--click", "20,24",
    ]);
    done(&["track", &project, "--tracker", "geometry"]);
    let tracked = info(&project, &[]);
    let counts = json!({ "confirmed": 1, "to_check": 0, "with_conflicts": false });
    assert_eq!(tracked["review"], counts);
    let origins = format!("{project}/masks/origins.json");
    let read = || std::fs::read_to_string(&origins).unwrap();
    let mut entries: Value = serde_json::from_str(&read()).unwrap();
    let name = tracked["frames"][3]["name"].as_str().unwrap();
    entries[name]["confidence"] = json!({ "1": 0.25 });
    std::fs::write(&origins, entries.to_string()).unwrap();
    let unsure = info(&project, &[]);
    let reason = json!([{ "reason": "low_confidence", "label": 1, "confidence": 0.25 }]);
    assert_eq!(unsure["frames"][3]["check"], reason);
    assert_eq!(unsure["review"]["to_check"], 1);
    let lenient = info(&project, &["--flag-below", "0.2"]);
    assert_eq!(lenient["review"]["to_check"], 0);

    assert!(refused(&["info", &project, "--conflicts"]).contains("fuse"));
    // On frame 2 the thing gets the other label, as if a tracker had done so.
    done(&["prompt", &project, "--frame", "2", "--label", "thing"]);
    done(&[
        "prompt", &project, "--frame", "2", "--label", "other", "--click", "18,24",
    ]);
    let stale = info(&project, &[]);
    assert_eq!(reasons(&stale)[1], ["stale"]);
    assert_eq!(stale["review"]["confirmed"], 2);
    let text = done(&["info", &project]);
    let to_check = stale["review"]["to_check"].as_u64().unwrap();
    assert!(to_check > 0);
    let line = format!("2 of 4 frames confirmed, {to_check} to check");
    assert!(text.lines().any(|shown| shown == line), "{text}");

    done(&["fuse", &project, "--voxel", "0.01"]);
    let text = done(&["info", &project]);
    assert!(text.contains("not counting conflicts"), "{text}");
    let kept = read();
    let as_tracked = kept.replace("\"anchor\"", "\"tracked\"");
    assert_ne!(kept, as_tracked);
    std::fs::write(&origins, as_tracked).unwrap();
    assert!(!reasons(&info(&project, &[]))[2].contains(&"conflict"));
    let compared = info(&project, &["--conflicts"]);
    assert!(reasons(&compared)[2].contains(&"conflict"), "{compared}");
    assert_eq!(compared["review"]["with_conflicts"], true);
    let text = done(&["info", &project, "--conflicts"]);
    assert!(!text.contains("not counting"), "{text}");
}
