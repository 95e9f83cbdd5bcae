% What tests/system/test_octave.py runs on a console with emulated boards; `at` is set before.
b = trocar.bridge(at);
assert(strcmp(b.grants, 'command') && b.may_power)
system = trocar.system(b);
psm = trocar.psm('PSM1', b);
refused = @(identifier, what) assert(strcmp(identifier, what));
try
    psm.move_jp([0 0 0.12 0 0 0]);
    error('it moved without power');
catch reason
    refused(reason.identifier, 'trocar:refused');
end
system.home(120);
assert(psm.is_homed() && psm.is_enabled() && ~psm.is_disabled() && psm.connected())
assert(isequal(system.arms(), {'MTMR', 'PSM1'}))

% moves: they return at once, are waited for, and tell when they end before their goal
handle = psm.move_jp([0.2 0 0.12 0 0 0]);
assert(handle.is_busy())
assert(handle.wait(true))
psm.wait_for_busy(true);
assert(handle.wait() && ~handle.is_busy())
[jp, jv, jf, timestamp] = psm.measured_js();
assert(isequal(size(jp), [6 1]) && isequal(size(jv), [6 1]) && isequal(size(jf), [6 1]) && timestamp > 0)
assert(max(abs(jp - [0.2; 0; 0.12; 0; 0; 0])) < 5e-3)
first = psm.move_jp([0 0 0.12 0 0 0]);
second = psm.move_jp([0 0 0.14 0 0 0]);
second.wait(false, 60);
for count = 1:2
    try
        first.wait();
        error('a move that was replaced is done');
    catch reason
        refused(reason.identifier, 'trocar:refused');
    end
end
warning('off', 'trocar:clipped');
far = psm.move_jp([0 0 5 0 0 0]);
assert(~isempty(strfind(far.clipped, 'insertion')))
psm.hold();
psm.move_jr([0 0 -0.01 0 0 0]).wait();
psm.insert_jp(0.12).wait();

% poses
[pose, timestamp] = psm.measured_cp();
goal = psm.setpoint_cp();
goal(1, 4) = goal(1, 4) + 0.01;
psm.move_cp(goal).wait();
assert(max(max(abs(psm.setpoint_cp() - goal))) < 1e-6)
assert(max(max(abs(psm.measured_cp() - goal))) < 5e-3)
change = eye(4);
change(3, 4) = -0.005;
psm.move_cr(change).wait();
psm.servo_cp(psm.setpoint_cp(), zeros(1, 6));
psm.servo_cp(psm.local.setpoint_cp(), [], 'PSM1_base');
psm.servo_cr(eye(4));
psm.servo_cs(psm.setpoint_cp(), zeros(1, 6), []);
psm.servo_jp(psm.setpoint_jp(), zeros(6, 1));
psm.servo_jr(zeros(6, 1));
psm.servo_jv(zeros(6, 1));
psm.hold();
joints = psm.inverse_kinematics(psm.setpoint_jp(), psm.local.setpoint_cp());
assert(max(abs(joints - psm.setpoint_jp())) < 1e-3)
assert(max(max(abs(psm.local.forward_kinematics(joints) - psm.local.setpoint_cp()))) < 1e-4)
assert(isequal(size(psm.measured_cv()), [1 6]) && isequal(size(psm.measured_cf()), [1 6]))
assert(isequal(size(psm.body.jacobian()), [6 6]) && isequal(size(psm.spatial.jacobian()), [6 6]))
assert(max(max(abs(trocar.internal.matrix_of(trocar.internal.numbers_of(pose).') - pose))) < 1e-9)
for turn = {diag([1 -1 -1]), diag([-1 1 -1]), diag([-1 -1 1]), [0 -1 0; 1 0 0; 0 0 1]}
    q = trocar.internal.quaternion_of(turn{1});
    matrix = trocar.internal.matrix_of([0; 0; 0; q(:)]);
    assert(max(max(abs(matrix(1:3, 1:3) - turn{1}))) < 1e-12)
end

% the jaw, settings, states
psm.jaw.open(0.5).wait();
assert(abs(psm.jaw.measured_jp() - 0.5) < 0.05)
psm.jaw.close().wait();
psm.jaw.servo_jp(psm.jaw.setpoint_jp());
assert(~isempty(psm.tool()))
psm.trajectory_j_set_ratio(0.5);
begun = tic;
while psm.trajectory_j_get_ratio() ~= 0.5 && toc(begun) < 10
end
assert(psm.trajectory_j_ratio() == 0.5)
psm.trajectory_j_set_ratio(1);
psm.use_gravity_compensation(false);
far = eye(4);
far(3, 4) = 2;
psm.add_wall('far', 'sphere', far, 0.1, 0.001, 'tip');
psm.remove_wall('far');
assert(numel(psm.gravity_compensation.setpoint_jf()) == 6)
psm.pause();
assert(strcmp(psm.operating_state(), 'PAUSED'))
psm.resume();
psm.free();
psm.disable();
assert(~psm.is_homed())
psm.home();
assert(strcmp(psm.desired_state(), 'HOMED') && ischar(psm.reference_frame()))

% what is wrong is said
wrong = {@() psm.move_jp([1 2]), 'trocar:refused'; @() psm.move_jp([0 0 NaN 0 0 0]), 'trocar:refused';
         @() psm.move_cp(psm.setpoint_cp(), 'nowhere'), 'trocar:refused';
         @() psm.move_cp(eye(3)), 'trocar:argument'; @() psm.move_cp(2 * eye(4)), 'trocar:argument';
         @() psm.body.servo_cf([1 2]), 'trocar:argument'; @() psm.state_command('dance'), 'trocar:refused';
         @() psm.wait_for_operating_state('FAULT', 0.3), 'trocar:timeout'; @() trocar.ecm('PSM1', b), 'trocar:argument';
         @() trocar.psm('PSM9', b), 'trocar:argument'; @() b.read('PSM1/nothing'), 'trocar:refused';
         @() trocar.bridge('127.0.0.1:1', '', 0.3), 'trocar:lost'};
for row = 1:size(wrong, 1)
    try
        wrong{row, 1}();
        error('nothing was wrong in row %d', row);
    catch reason
        refused(reason.identifier, wrong{row, 2});
    end
end

% a master, sounds, a console and its teleoperation
mtm = trocar.mtm('MTMR', b);
mtm.body.servo_cf(zeros(1, 6));
mtm.lock_orientation_as_is();
mtm.unlock_orientation();
assert(islogical(mtm.gripper.closed()) && islogical(mtm.orientation_locked()))
system.set_volume(0.2);
system.beep(0.01, 440, 0.1);
system.string_to_speech('hello');
console = trocar.console('console', b);
assert(isequal(console.teleops(), {'MTMR_PSM1'}) && console.teleop_is_selected('MTMR_PSM1'))
console.teleop_unselect('MTMR_PSM1');
console.teleop_select('MTMR_PSM1');
teleop = trocar.teleop('MTMR_PSM1', b);
console.teleop_set_scale(0.3);
console.teleop_start();
console.emulate_operator_present(true);
begun = tic;
while ~(strcmp(teleop.desired_state(), 'ENABLED') && teleop.get_scale() == 0.3) && toc(begun) < 30
end
assert(strcmp(teleop.desired_state(), 'ENABLED') && teleop.get_scale() == 0.3 && ischar(teleop.reason()))
console.teleop_stop();
teleop.wait_for_state('DISABLED', 60);
system.power_off(60);
assert(psm.is_disabled())
try
    psm.measured_cp();
    psm.measured_cp();
catch reason
    refused(reason.identifier, 'trocar:timeout');
end
disp('all words')

% the bridge dies: whoever waits or asks is told, and comes back with a new object
try
    while true
        psm.is_homed();
    end
catch reason
    refused(reason.identifier, 'trocar:lost');
end
psm = trocar.psm('PSM1', at);
assert(psm.is_disabled())
disp('back again')
