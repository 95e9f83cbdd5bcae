classdef console < trocar.operated
    % A console: an operator's pedals, and the teleoperations that they decide upon. trocar.console(), or by name.

    methods

        function self = console(name, varargin)
            % `console` unless another name is given.
            if nargin < 1, name = 'console'; end
            self@trocar.operated(name, 'console', varargin{:});
        end

        function teleop_start(self)
            % Let the selected teleoperations run: from now on the operator decides.
            self.command('teleop_enable', 1);
        end

        function teleop_stop(self)
            % Let none run.
            self.command('teleop_enable', 0);
        end

        function result = teleop_enabled(self)
            % Whether teleoperation is wanted.
            row = self.state();
            result = logical(row.teleop_enabled);
        end

        function names = teleops(self)
            % Names of its teleoperations: a cell array.
            row = self.state();
            names = row.teleop(:).';
        end

        function teleop_select(self, name)
            % Select a teleoperation; those that share an arm with it are not any more.
            self.command('select_teleop', [], name);
        end

        function teleop_unselect(self, name)
            % Unselect it.
            self.command('unselect_teleop', [], name);
        end

        function result = teleop_is_selected(self, name)
            % Whether it is; trocar:argument when there is none of that name.
            row = self.state();
            place = strcmp(row.teleop, name);
            if ~any(place)
                error('trocar:argument', 'there is no teleoperation %s; there are %s', name, ...
                      strjoin(row.teleop(:).', ', '));
            end
            result = logical(row.selected(place));
        end

        function teleop_set_scale(self, scale)
            % Ratio of the slave's motion to the master's, above 0, for all its teleoperations.
            self.command('set_scale', scale);
        end

        function scale = teleop_get_scale(self)
            % The scale last asked for.
            row = self.state();
            scale = row.scale;
        end

        function result = operator_present(self)
            % Whether the operator is present.
            row = self.state();
            result = logical(row.operator_present);
        end

        function result = clutch(self)
            % Whether the clutch is pressed.
            row = self.state();
            result = logical(row.clutch);
        end

        function result = camera(self)
            % Whether the camera pedal is pressed.
            row = self.state();
            result = logical(row.camera);
        end

        function emulate_operator_present(self, present)
            % As if the operator came or went.
            self.command('emulate_operator_present', trocar.internal.flag(present));
        end

        function emulate_clutch(self, pressed)
            % As if the clutch were pressed, or released.
            self.command('emulate_clutch', trocar.internal.flag(pressed));
        end

        function emulate_camera(self, pressed)
            % As if the camera pedal were pressed, or released.
            self.command('emulate_camera', trocar.internal.flag(pressed));
        end

    end

end
