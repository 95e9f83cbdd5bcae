classdef measured < handle
    % Where joints are: an arm's, a jaw's, a gripper's, a setup arm's.

    properties (Access = protected)
        joints_of    % the bridge
        joints_path  % begin of the names of their topics
    end

    methods

        function self = measured(bridge, path)
            % `path`: PSM1/, PSM1/jaw/.
            self.joints_of = bridge;
            self.joints_path = path;
        end

        function [jp, jv, jf, timestamp] = measured_js(self)
            % Positions, velocities and efforts as columns (rad, m; N·m, N), and when (s, of the robot's clock).
            [jp, jv, jf, timestamp] = self.joints_of.joint_state([self.joints_path 'measured_js']);
        end

        function [jp, timestamp] = measured_jp(self)
            % Positions.
            [jp, ~, ~, timestamp] = self.measured_js();
        end

        function [jv, timestamp] = measured_jv(self)
            % Velocities.
            [~, jv, ~, timestamp] = self.measured_js();
        end

        function [jf, timestamp] = measured_jf(self)
            % Efforts.
            [~, ~, jf, timestamp] = self.measured_js();
        end

        function names = joint_names(self)
            % Their names, in order: a cell array.
            row = self.joints_of.valid([self.joints_path 'measured_js']);
            names = row.name(:).';
        end

    end

end
